import time

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.eigenspace.pca import eigenspace_of, principal_components
from panoloc_mcl.robot.errors import MapError


@pytest.fixture(autouse=True)
def one_thread_in_libraries():
    """Matrices this small only wait for the other threads."""
    with threadpool_limits(1):
        yield


def like_views(count: int, pixels: int = 120, waves: int = 6, seed: int = 0) -> np.ndarray:
    """Complex images that change smoothly from one to the next, with a little noise."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, count)[:, None]
    shapes = rng.standard_normal((waves, pixels)) + 1j * rng.standard_normal((waves, pixels))
    weights = np.exp(2j * np.pi * t * np.arange(1, waves + 1)) / np.arange(1, waves + 1)
    noise = rng.standard_normal((count, pixels)) + 1j * rng.standard_normal((count, pixels))
    return (weights @ shapes + 1e-3 * noise).astype(np.complex64)


@pytest.mark.parametrize("count", [1, 7, 300])
def test_few_images_give_their_principal_components(count: int) -> None:
    images = like_views(count)
    components = min(5, count)
    space = eigenspace_of(images.__getitem__, count, components, 60, "p")
    expected = principal_components(images, components, "p")
    assert np.array_equal(space.eigenimages, expected.eigenimages)
    assert np.array_equal(space.coefficients, expected.coefficients)
    assert space.kept == expected.kept


@pytest.mark.parametrize("count", [301, 450])
def test_many_images_are_all_projected(count: int) -> None:
    images = like_views(count)
    space = eigenspace_of(images.__getitem__, count, 6, 60, "p", threads=2)
    assert space.coefficients.shape == (count, 6)
    assert space.coefficients.dtype == space.eigenimages.dtype == np.complex64
    assert np.abs(space.eigenimages @ space.eigenimages.conj().T - np.eye(6)).max() < 1e-4
    assert space.coefficients == pytest.approx(images @ space.eigenimages.conj().T, abs=1e-3)
    # As good as the best basis of all of them.
    left = np.linalg.norm(images - space.coefficients @ space.eigenimages)
    best = np.sqrt((np.linalg.svd(images, compute_uv=False)[6:] ** 2).sum())
    assert left < 1.02 * best + 1e-3
    assert space.kept > 0.999


@pytest.mark.parametrize("count", [20, 320])
def test_the_result_does_not_depend_on_the_threads(count: int) -> None:
    images = like_views(count)
    made: list[int] = []

    def image(index: int) -> np.ndarray:
        # Later ones are ready sooner.
        time.sleep(0.002 * (index % 3 == 0))
        made.append(index)
        return images[index]

    one, other = (eigenspace_of(image, count, 5, 60, "p", threads=threads) for threads in (1, 4))
    assert np.array_equal(one.eigenimages, other.eigenimages)
    assert np.array_equal(one.coefficients, other.coefficients)
    # Each is made once, for they are what takes the time.
    assert sorted(made) == sorted(2 * list(range(count)))


def test_left_out_components_are_the_default_as_far_as_images_span_them() -> None:
    images = like_views(40, waves=20)
    assert len(eigenspace_of(images.__getitem__, 40, None, 12, "p").eigenimages) == 12
    alike = np.concatenate([images[:3]] * 4)
    assert len(eigenspace_of(alike.__getitem__, 12, None, 12, "p").eigenimages) == 3
    with pytest.raises(MapError, match="at most 3"):
        eigenspace_of(alike.__getitem__, 12, 5, 12, "p")


def test_progress_counts_every_image_in_order() -> None:
    images = like_views(310)
    calls: list[tuple[int, int, str]] = []
    eigenspace_of(images.__getitem__, 310, 3, 60, "p", lambda *call: calls.append(call), threads=3)
    assert [done for done, _, _ in calls] == list(range(1, 311))
    assert {(total, what) for _, total, what in calls} == {(310, "views")}


def test_a_fault_in_one_image_comes_through() -> None:
    def image(index: int) -> np.ndarray:
        if index == 9:
            raise MapError("image 9 is bad")
        return like_views(20)[index]

    with pytest.raises(MapError, match="image 9"):
        eigenspace_of(image, 20, 3, 60, "p", threads=2)

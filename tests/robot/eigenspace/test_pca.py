import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.eigenspace.pca import principal_components, spanned
from panoloc_mcl.robot.errors import MapError


def some_images(seed: int, count: int, pixels: int, kind: str, rank: int | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rank = rank or count
    images = rng.standard_normal((count, rank)) @ rng.standard_normal((rank, pixels))
    if kind == "complex":
        images = images + 1j * (rng.standard_normal((count, rank)) @ rng.standard_normal((rank, pixels)))
        return images.astype(np.complex64)
    return images.astype(np.float32)


KINDS = st.sampled_from(["real", "complex"])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12), st.integers(20, 80), KINDS, st.data())
def test_the_basis_is_orthonormal_and_holds_the_coefficients(seed: int, count: int, pixels: int, kind: str, data) -> None:
    images = some_images(seed, count, pixels, kind)
    components = data.draw(st.integers(1, count))
    energies = np.linalg.svd(images.astype(np.complex128), compute_uv=False) ** 2
    # Seldom, images drawn at random are all but dependent: less than a millionth of the energy is refused, as rounding.
    assume(energies[components - 1] > 2e-6 * energies[0])
    space = principal_components(images, components, "p")
    basis, coefficients = space.eigenimages, space.coefficients
    assert basis.dtype == coefficients.dtype == images.dtype
    # The smallest eigenvalue of such images may be 1e-4 of the largest: single precision leaves 1e-3 of it.
    assert np.abs(basis @ basis.conj().T - np.eye(components)).max() < 5e-3
    projected = images @ basis.conj().T
    scale = np.abs(images).max() * np.sqrt(pixels)
    assert np.abs(projected - coefficients).max() < 1e-3 * scale
    assert 0.0 < space.kept <= 1.0
    assert space.kept == pytest.approx(energies[:components].sum() / energies.sum(), abs=1e-5)


@pytest.mark.parametrize("kind", ["real", "complex"])
def test_all_components_reconstruct_the_images(kind: str) -> None:
    images = some_images(0, 9, 200, kind)
    space = principal_components(images, 9, "p")
    assert np.abs(space.coefficients @ space.eigenimages - images).max() < 1e-4 * np.abs(images).max()
    assert space.kept == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["real", "complex"])
def test_fewer_components_are_the_best_approximation(kind: str) -> None:
    images = some_images(1, 8, 150, kind)
    errors = []
    for components in range(1, 9):
        space = principal_components(images, components, "p")
        errors.append(np.linalg.norm(images - space.coefficients @ space.eigenimages))
    singular = np.linalg.svd(images, compute_uv=False)
    best = [np.sqrt((singular[components:] ** 2).sum()) for components in range(1, 9)]
    assert errors == pytest.approx(best, abs=1e-4 * float(singular[0]))


@pytest.mark.parametrize("kind", ["real", "complex"])
def test_too_many_components_are_refused_in_one_line(kind: str) -> None:
    images = some_images(2, 7, 100, kind, rank=3)
    assert spanned(images) == (3 if kind == "real" else 6)
    with pytest.raises(MapError) as caught:
        principal_components(images, 7, "observation.votes.components")
    (line,) = caught.value.faults
    assert line.startswith("observation.votes.components = 7: 7 references span only")
    assert f"at most {spanned(images)}" in line


def test_equal_images_span_one() -> None:
    images = np.tile(some_images(3, 1, 100, "complex"), (5, 1))
    assert spanned(images) == 1
    space = principal_components(images, 1, "p")
    assert np.allclose(space.coefficients @ space.eigenimages, images, atol=1e-5)


def test_nothing_at_all_spans_nothing() -> None:
    assert spanned(np.zeros((3, 50), np.float32)) == 0
    with pytest.raises(MapError):
        principal_components(np.zeros((3, 50), np.float32), 1, "p")


@pytest.mark.parametrize("kind", ["real", "complex"])
def test_signs_and_phases_are_fixed(kind: str) -> None:
    images = some_images(4, 6, 100, kind)
    flipped = images * (-1.0 if kind == "real" else np.exp(2j))
    one = principal_components(images, 6, "p")
    other = principal_components(flipped.astype(images.dtype), 6, "p")
    # Turning all images turns the eigenimages; the coefficients, whose sign is fixed, stay.
    assert np.abs(one.coefficients - other.coefficients).max() < 1e-3 * np.abs(one.coefficients).max()

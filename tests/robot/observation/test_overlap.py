import numpy as np
import pytest
from oracles import overlaps as brute

from panoloc_mcl.robot.observation.overlap import OverlapNorms, block_energy, block_usable

SHAPES = [(36, 90, 3, 18), (20, 60, 1, 12), (30, 64, 2, 12), (8, 17, 1, 4)]


def some_features(seed: int, rows: int, columns: int, hidden: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Features, and a mask that hides a bar of columns and the rim rows."""
    rng = np.random.default_rng(seed)
    usable = np.ones((rows, columns), dtype=bool)
    usable[:, (rng.integers(columns) + np.arange(hidden)) % columns] = False
    usable[[0, -1]] = False
    z = (rng.standard_normal((rows, columns)) + 1j * rng.standard_normal((rows, columns))).astype(np.complex64)
    return np.where(usable, z, 0), usable


def norms_of(features: list[tuple[np.ndarray, np.ndarray]]) -> OverlapNorms:
    return OverlapNorms(np.stack([block_energy(z) for z, _ in features]), np.stack([block_usable(u) for _, u in features]))


@pytest.mark.parametrize(("rows", "columns", "block_rows", "block_columns"), SHAPES)
def test_blocks_agree_with_loops(rows: int, columns: int, block_rows: int, block_columns: int) -> None:
    z, usable = some_features(1, rows, columns, columns // 3)
    assert block_energy(z) == pytest.approx(brute.blocks(np.abs(z) ** 2, block_rows, block_columns), rel=1e-5)
    countable = np.ones(usable.shape)
    countable[[0, -1]] = 0.0
    share = brute.blocks(usable, block_rows, block_columns) / brute.blocks(countable, block_rows, block_columns)
    assert block_usable(usable) == pytest.approx(share, rel=1e-5)
    assert block_energy(z).sum() == pytest.approx((np.abs(z) ** 2).sum(), rel=1e-5)


@pytest.mark.parametrize(("rows", "columns", "block_rows", "block_columns"), SHAPES)
def test_norms_agree_with_brute_force_over_blocks(rows: int, columns: int, block_rows: int, block_columns: int) -> None:
    places = [some_features(seed, rows, columns, hidden) for seed, hidden in ((2, 0), (3, columns // 4), (4, columns // 2))]
    z, usable = some_features(5, rows, columns, columns // 3)
    norms = norms_of(places)
    found = norms.of(z, usable)
    assert found.shape == (block_columns, 3)
    expected = brute.by_blocks(block_energy(z), block_usable(usable), norms.energy, norms.usable)
    assert found == pytest.approx(expected, rel=1e-4)


def test_norms_are_close_to_those_of_the_pixels() -> None:
    places = [some_features(seed, 36, 90, hidden) for seed, hidden in ((2, 0), (3, 30))]
    z, usable = some_features(5, 36, 90, 25)
    found = brute.between_blocks(norms_of(places).of(z, usable), 90)
    expected = brute.by_pixels(z, usable, *zip(*places, strict=True))
    assert np.abs(found / expected - 1.0).max() < 0.06


def test_without_masks_the_norms_are_those_of_the_images() -> None:
    place, image = some_features(1, 36, 90), some_features(2, 36, 90)
    found = norms_of([place]).of(*image)
    assert found == pytest.approx(np.linalg.norm(place[0]) * np.linalg.norm(image[0]), rel=1e-4)


def test_a_vanishing_overlap_is_not_blown_up() -> None:
    z, usable = some_features(1, 36, 90)
    left, right = usable.copy(), usable.copy()
    left[:, :45], right[:, 45:] = False, False
    norms = norms_of([(np.where(left, z, 0), left)])
    found = norms.of(np.where(right, z, 0), right)
    assert found.min() == pytest.approx(0.01 * np.linalg.norm(z[left]) * np.linalg.norm(z[right]), rel=1e-3)
    assert np.isfinite(found).all()

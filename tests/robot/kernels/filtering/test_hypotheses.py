import numpy as np
import pytest
from oracles import kernels as naive

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.kernels.filtering import hypotheses


@pytest.mark.parametrize("around", [1, 24, 36])
@pytest.mark.parametrize("far", [0.0, 4000.0])
def test_cells_and_their_moments_agree_with_numpy(variant, around: int, far: float) -> None:
    rng = np.random.default_rng(7)
    some = rng.uniform([-5.0, -5.0, -np.pi], [5.0, 5.0, np.pi], (700, 3))
    # One so far off that the cells are too many for a table.
    some[-1, 0] += far
    particles, weights = CompactPoses.of(some, (0.0, 0.0)), rng.random(700).astype(np.float32)
    occupied, moments, *grid = variant(hypotheses.occupied_cells)(*particles.arrays, weights, 0.625, around)
    expected, expected_moments, *expected_grid = naive.occupied_cells(particles.poses, weights, 0.625, around)
    assert np.array_equal(occupied, expected)
    assert grid == expected_grid
    # Offsets are of single precision: at 4000 m, to a quarter of a millimetre.
    assert moments == pytest.approx(expected_moments, rel=2e-6, abs=1e-6 if far == 0.0 else 1e-3)
    assert moments[:, 0].sum() == pytest.approx(weights.sum(dtype=np.float64), rel=1e-12)


def test_hypotheses_are_the_merged_cells_that_touch(variant) -> None:
    rng = np.random.default_rng(3)
    some = np.vstack([rng.normal([0.0, 0.0, 0.5], 0.05, (300, 3)), rng.normal([3.0, 1.0, -2.0], 0.05, (100, 3))])
    particles, weights = CompactPoses.of(some), np.full(400, 1.0 / 400, dtype=np.float32)
    masses, means, covariances = variant(hypotheses.hypotheses)(*particles.arrays, weights, 0.4, 24, 0.01)
    first, second = np.argsort(-masses)[:2]
    for label, part in ((first, some[:300]), (second, some[300:])):
        assert masses[label] == pytest.approx(len(part) / 400, rel=1e-6)
        assert means[label, :2] + particles.origin == pytest.approx(part[:, :2].mean(axis=0), abs=1e-6)
        assert covariances[label, :2, :2] == pytest.approx(np.cov(part[:, :2].T, ddof=0), abs=1e-7)


@pytest.mark.parametrize(("cells", "labels"), [(1, 1), (9, 2), (40, 5)])
def test_merged_cells_agree_with_numpy(variant, cells: int, labels: int) -> None:
    rng = np.random.default_rng(cells)
    which = np.concatenate([np.arange(labels), rng.integers(0, labels, cells - labels)])
    # Around the seam, so that headings of one label lie on both sides of it.
    origins = np.column_stack([rng.uniform(-5.0, 5.0, (cells, 2)), np.pi + rng.uniform(-1.0, 1.0, cells)])
    origins[:, 2] = np.mod(origins[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    weights, offsets = rng.random((cells, 6)), rng.uniform(-0.2, 0.2, (cells, 6, 3))
    x, y, t = np.moveaxis(offsets, -1, 0)
    powers = np.stack([np.ones_like(x), x, y, t, x * x, x * y, y * y, x * t, y * t, t * t], axis=-1)
    moments = np.sum(weights[..., None] * powers, axis=1)
    merged = variant(hypotheses.merge_cells)(which, labels, origins, moments)
    for ours, expected in zip(merged, naive.merge_cells(which, labels, origins, moments), strict=True):
        assert ours == pytest.approx(expected, abs=1e-12)
    assert (np.linalg.eigvalsh(merged[2]) > -1e-12).all()


@pytest.mark.parametrize(("cells", "turns"), [(1, 24), (30, 24), (120, 24), (300, 3)])
def test_links_agree_with_flooding(variant, cells: int, turns: int) -> None:
    rng = np.random.default_rng(cells)
    rows, columns = 12, 10
    # None at the rim.
    inner = rng.integers(1, columns - 1, cells) * rows + rng.integers(1, rows - 1, cells)
    occupied = np.unique(inner * turns + rng.integers(0, turns, cells))
    heavy = rng.random(len(occupied)) < 0.7
    heavy[0] = True
    labels = variant(hypotheses.link_cells)(occupied, heavy, rows, turns)
    flooded, touch = naive.link_cells(occupied, heavy, rows, turns)
    for one in range(len(occupied)):
        if heavy[one]:
            assert np.array_equal(labels[heavy] == labels[one], flooded[heavy] == flooded[one])
        elif (touch[one] & heavy).any():
            assert labels[one] in labels[touch[one] & heavy]
        else:
            assert np.sum(labels == labels[one]) == 1
    firsts = [int(np.flatnonzero(labels == label)[0]) for label in range(labels.max() + 1)]
    assert firsts == sorted(firsts)


@pytest.mark.parametrize("count", [1, 63, 64, 65, 300])
def test_ends_are_those_of_numpy(variant, count: int) -> None:
    values = np.random.default_rng(count).normal(size=count).astype(np.float32)
    assert variant(hypotheses.lowest_and_highest)(values) == (values.min(), values.max())

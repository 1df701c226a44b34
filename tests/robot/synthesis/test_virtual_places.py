import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import grid
from scipy.spatial import cKDTree

from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings
from panoloc_mcl.robot.synthesis import virtual_positions
from panoloc_mcl.robot.synthesis.spacing import local_spacings

BY_RULE = VirtualPlacesSettings()


def spacing_of(positions: np.ndarray) -> float:
    return float(np.min(cKDTree(positions).query(positions, k=2)[0][:, 1]))


def brute_force(references: np.ndarray, spacing: float, reach: float) -> np.ndarray:
    """The whole rectangle, point by point."""
    margin = np.ceil(reach / spacing) * spacing
    low = references.min(axis=0) - margin
    counts = np.rint((references.max(axis=0) + margin - low) / spacing).astype(int) + 1
    points = [(low[0] + i * spacing, low[1] + k * spacing) for k in range(counts[1]) for i in range(counts[0])]
    return np.array([p for p in points if np.hypot(*(references - p).T).min() <= reach + 1e-9])


@pytest.mark.parametrize(("apart", "expected"), [(0.2, 0.15), (0.5, 0.15), (0.8, 0.2), (1.0, 0.25), (4.0, 0.25)])
def test_the_spacing_follows_that_of_the_references(apart: float, expected: float) -> None:
    positions = virtual_positions(grid(4, 3, apart), apart, BY_RULE)
    assert spacing_of(positions) == pytest.approx(expected)
    assert spacing_of(virtual_positions(grid(4, 3, apart), apart, VirtualPlacesSettings(spacing_m=0.3))) == pytest.approx(0.3)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 25), st.integers(0, 1000), st.floats(0.3, 2.0))
def test_scattered_references_are_covered_and_nothing_else(count: int, seed: int, apart: float) -> None:
    references = np.random.default_rng(seed).uniform(-3.0, 3.0, (count, 2))
    positions = virtual_positions(references, apart, BY_RULE)
    expected = brute_force(references, float(np.clip(apart / 4.0, 0.15, 0.25)), max(0.75 * apart, 0.5))
    assert positions.shape == expected.shape
    assert positions == pytest.approx(expected)


@pytest.mark.parametrize(("columns", "rows"), [(5, 4), (4, 1), (1, 5), (1, 1)])
def test_every_cell_of_a_grid_is_covered(columns: int, rows: int) -> None:
    references = grid(columns, rows)
    positions = virtual_positions(references, 1.0, BY_RULE)
    rng = np.random.default_rng(0)
    inside = rng.uniform((0.0, 0.0), (columns - 1 + 1e-9, rows - 1 + 1e-9), (500, 2))
    assert cKDTree(positions).query(inside)[0].max() <= 0.5 * np.sqrt(2.0) * 0.25 + 1e-9
    assert cKDTree(references).query(positions)[0].max() <= 0.75 + 1e-9
    # The references themselves are among them, and a single row has places on both sides.
    assert cKDTree(positions).query(references)[0].max() < 1e-9
    assert positions[:, 1].min() == pytest.approx(-0.75)
    assert positions[:, 1].max() == pytest.approx(rows - 1 + 0.75)


def test_separate_places_have_nothing_between_them_and_cost_nothing() -> None:
    """A rectangle around both would hold 10^13 places."""
    here, there = grid(3, 2), grid(3, 2) + 1e6
    positions = virtual_positions(np.concatenate([here, there]), 1.0, BY_RULE)
    alone = virtual_positions(here, 1.0, BY_RULE)
    near = np.hypot(*positions.T) < 1e5
    assert positions[near] == pytest.approx(alone)
    assert positions[~near] == pytest.approx(alone + 1e6)


def test_the_reach_is_local_and_has_a_floor() -> None:
    """A dense line and a sparse one: the dense one is not left with a thread of ground, and the sparse one has no gaps."""
    dense = np.column_stack([np.arange(0.0, 3.0, 0.05), np.zeros(60)])
    sparse = np.column_stack([np.arange(0.0, 6.0, 1.5), np.full(4, 20.0)])
    references = np.concatenate([dense, sparse])
    positions = virtual_positions(references, 0.05, BY_RULE, local_spacings(references))
    tree = cKDTree(positions)
    beside = np.column_stack([np.linspace(0.2, 2.8, 30), np.full(30, 0.4)])
    between = np.column_stack([np.linspace(0.0, 4.5, 50), np.full(50, 20.0)])
    assert tree.query(beside)[0].max() <= 0.15
    assert tree.query(between)[0].max() <= 0.15
    assert spacing_of(positions) == pytest.approx(0.15)


def test_doubled_references_have_the_spacing_of_the_others() -> None:
    doubled = np.concatenate([grid(4, 3), grid(4, 3) + np.array([0.001, 0.0])])
    assert local_spacings(doubled) == pytest.approx(1.0, abs=0.01)
    assert local_spacings(np.concatenate([grid(4, 3)] * 3)) == pytest.approx(1.0)
    assert local_spacings(np.zeros((3, 2))) == pytest.approx(1.0)

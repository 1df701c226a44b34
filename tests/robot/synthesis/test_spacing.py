"""How far apart references usually are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from panoloc_mcl.robot.synthesis.spacing import usual_spacing

x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
GRID = np.column_stack([x.ravel(), y.ravel()])


def test_a_single_reference_has_a_metre_to_itself() -> None:
    assert usual_spacing(np.zeros((1, 2))) == 1.0
    assert usual_spacing(np.zeros((3, 2))) == 1.0


@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
def test_it_is_the_median_way_to_the_nearest_one(seed: int, count: int) -> None:
    positions = np.random.default_rng(seed).uniform(0.0, 10.0, (count, 2))
    apart = cdist(positions, positions) + np.diag(np.full(count, np.inf))
    nearest, second = np.median(np.sort(apart, axis=1)[:, : min(2, count - 1)], axis=0)[[0, -1]]
    assert usual_spacing(positions) == pytest.approx(second if nearest < 0.25 * second else nearest)


@pytest.mark.parametrize("apart", [0.0, 0.02, 0.1])
def test_places_that_are_there_twice_are_as_far_apart_as_once(apart: float) -> None:
    rng = np.random.default_rng(1)
    turns = rng.uniform(0.0, 2.0 * np.pi, len(GRID))
    again = GRID + apart * np.column_stack([np.cos(turns), np.sin(turns)])
    assert usual_spacing(np.vstack([GRID, again])) == pytest.approx(1.0, abs=0.1)


def test_some_that_are_there_twice_change_nothing() -> None:
    assert usual_spacing(np.vstack([GRID, GRID[:9] + 0.02])) == pytest.approx(1.0, abs=0.05)

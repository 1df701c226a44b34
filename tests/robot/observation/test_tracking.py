import numpy as np
import pytest
from oracles.fields import hills
from oracles.scenes import grid

from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.observation.tracking import Expected

PLACES = Places(grid(6, 5))
HERE, THERE = np.array([1.0, 1.0, 0.5]), np.array([4.0, 3.0, -2.0])


def at(pose: np.ndarray) -> Expected:
    expected = Expected.of(pose, 0.02, 1.0)
    assert expected is not None
    return expected


@pytest.mark.parametrize(("spread_m", "spread_deg"), [(0.2, 0.5), (0.01, 5.0)])
def test_a_wide_belief_expects_nothing(spread_m: float, spread_deg: float) -> None:
    assert Expected.of(HERE, spread_m, spread_deg) is None


def test_votes_that_point_elsewhere_refute_what_was_expected() -> None:
    field = hills(PLACES, HERE)
    assert at(HERE).fits(field)
    assert not at(THERE).fits(field)
    # The same place, but turned.
    assert not at(HERE + np.array([0.0, 0.0, 2.0])).fits(field)


def test_a_belief_that_is_less_sure_of_its_heading_reaches_farther() -> None:
    off = HERE + np.array([0.0, 0.0, np.radians(12.0)])
    sure, less = Expected.of(off, 0.02, 0.5), Expected.of(off, 0.02, 3.5)
    assert sure is not None
    assert sure.near
    assert not sure.fits(hills(PLACES, HERE))
    assert less is not None
    assert not less.near
    assert less.fits(hills(PLACES, HERE))


def test_a_pose_that_leaves_what_was_expected_is_no_proof() -> None:
    expected = at(HERE)
    assert expected.holds(HERE + np.array([0.06, -0.06, 0.02]))
    assert expected.holds(HERE + np.array([0.0, 0.0, 2.0 * np.pi]))
    assert not expected.holds(HERE + np.array([0.2, 0.0, 0.0]))
    assert not expected.holds(HERE + np.array([0.0, 0.0, 0.2]))

import math

import numpy as np
import pytest

from panoloc_mcl.robot.filters import OdometryOnlyFilter, Start, Status
from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.motion.models import differential, taken_apart
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.settings.localizer import MotionSettings, StatusSettings

PLACES = Places(np.array([(float(x), float(y)) for y in range(4) for x in range(5)]))


def a_filter(**start):
    return OdometryOnlyFilter(PLACES, Start(**start), StatusSettings())


def driven(x, y, turn):
    increment = np.array([x, y, turn])
    return differential(taken_apart(increment, math.hypot(x, y), abs(turn)), MotionSettings())


def test_it_goes_where_odometry_leads():
    belief = a_filter(position=(1.0, 1.0), heading=0.5)
    expected = np.array([1.0, 1.0, 0.5])
    for step in ((0.5, 0.1, 0.3), (0.4, -0.1, -0.2), (-0.3, 0.0, 0.1)):
        belief.propagate(driven(*step))
        expected = compose(expected, np.array(step))
    np.testing.assert_allclose(belief.state().clusters[0].pose, expected, atol=1e-12)
    assert belief.state().best_place == int(np.argmin(np.hypot(*(PLACES.positions - expected[:2]).T)))


def test_its_covariance_is_that_of_sampled_drives():
    rng = np.random.default_rng(0)
    belief = a_filter(position=(2.0, 1.0), heading=0.3, sd_position=0.05, sd_heading=0.05)
    sampled = np.array([2.0, 1.0, 0.3]) + rng.standard_normal((100_000, 3)) * 0.05
    for step in ((0.3, 0.05, 0.2), (0.3, 0.0, -0.4), (0.2, -0.05, 0.1)):
        motion = driven(*step)
        belief.propagate(motion)
        first, along, across, last = (
            mean + sd * rng.standard_normal(len(sampled))
            for mean, sd in (
                (motion.first_turn, motion.sd_first_turn),
                (motion.along, motion.sd_along),
                (motion.across, motion.sd_across),
                (motion.last_turn, motion.sd_last_turn),
            )
        )
        direction = sampled[:, 2] + first
        cos, sin = np.cos(direction), np.sin(direction)
        sampled += np.stack([along * cos - across * sin, along * sin + across * cos, first + last], axis=1)
    np.testing.assert_allclose(belief.covariance, np.cov(sampled.T), atol=3e-4)


def test_it_is_sure_until_the_drift_is_too_large_and_never_again():
    belief = a_filter(position=(2.0, 1.0), heading=0.0)
    assert belief.state().status is Status.CONVERGED
    for _ in range(40):
        belief.propagate(driven(0.5, 0.0, 0.0))
    assert belief.state().status is Status.SEARCHING


@pytest.mark.parametrize("start", [{}, {"heading": 1.0}])
def test_without_a_start_it_stays_in_the_middle_and_says_so(start):
    state = a_filter(**start).state()
    np.testing.assert_allclose(state.clusters[0].pose[:2], (2.0, 1.5))
    assert state.status is Status.SEARCHING


def test_standing_changes_nothing_and_a_state_can_be_restored():
    belief = a_filter(position=(2.0, 1.0), heading=0.2)
    before = belief.covariance.copy()
    belief.propagate(Motion(np.zeros(3)))
    np.testing.assert_array_equal(belief.covariance, before)
    belief.propagate(driven(0.5, 0.1, 0.3))
    other = a_filter()
    other.restore(*belief.snapshot())
    np.testing.assert_array_equal(other.pose, belief.pose)
    with pytest.raises(ValueError, match="shape"):
        other.restore({"pose": np.zeros(2), "covariance": np.zeros((3, 3))}, {"form": "odometry_only/2"})
    with pytest.raises(ValueError, match="form"):
        other.restore(belief.snapshot()[0], {})

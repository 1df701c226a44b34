"""What the particle filter makes of a pose that the image gives by itself."""

import numpy as np
import pytest
from oracles.fields import hills, moved
from oracles.scenes import grid

from panoloc_mcl.robot.filters import MonteCarloFilter, Start, Status
from panoloc_mcl.robot.geometry import angle_difference, compose
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings, StatusSettings

PLACES = Places(grid(6, 5))
HERE, THERE = np.array([1.37, 1.62, 0.5]), np.array([4.0, 3.0, -2.5])
STEP = moved(0.0, 0.0, 0.0)  # no motion, but some noise
COVARIANCE = np.diag([0.004, 0.004, np.radians(0.1)]) ** 2


def a_filter(start: Start | None = None, seed: int = 0, **settings) -> MonteCarloFilter:
    chosen = MonteCarloSettings(particles=1000, **settings)
    return MonteCarloFilter(PLACES, start or Start(), chosen, StatusSettings(), np.random.default_rng(seed))


def measured(pose: np.ndarray, votes_at: np.ndarray | None = None):
    """Blunt votes and a sharp pose."""
    field = hills(PLACES, pose if votes_at is None else votes_at)
    return field.with_measurement(PoseMeasurement(pose, COVARIANCE, np.zeros(2), Agreement(0.9, np.full(24, 0.9), 0.9)))


def far(pose: np.ndarray, truth: np.ndarray) -> float:
    return float(np.hypot(*(pose[:2] - truth[:2])))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("heading", [0.5, np.pi - 1e-3])
def test_the_estimate_is_as_sharp_as_the_measured_pose(seed: int, heading: float) -> None:
    truth = np.array([1.37, 1.62, heading])
    with_it, without = a_filter(seed=seed), a_filter(seed=seed)
    for _ in range(5):
        for belief in (with_it, without):
            belief.propagate(STEP)
        with_it.update(measured(truth))
        without.update(hills(PLACES, truth))
    state = with_it.state()
    best, blunt = state.clusters[0], without.state().clusters[0]
    assert state.status is Status.CONVERGED
    assert far(best.pose, truth) < 0.02
    assert abs(angle_difference(best.pose[2], truth[2])) < np.radians(1.0)
    assert blunt.spread_m > 0.1
    assert far(best.pose, truth) < 0.1 * blunt.spread_m
    assert best.spread_m < 0.5 * blunt.spread_m
    assert ((with_it.poses[:, 2] >= -np.pi) & (with_it.poses[:, 2] < np.pi)).all()


@pytest.mark.parametrize("seed", range(4))
def test_one_wrong_pose_does_not_take_over_a_converged_belief(seed: int) -> None:
    belief = a_filter(seed=seed)
    for _ in range(5):
        belief.propagate(STEP)
        belief.update(measured(HERE))
    belief.propagate(STEP)
    # The votes still see the truth, but the refined pose is somewhere else.
    belief.update(measured(THERE, votes_at=HERE))
    assert far(belief.state().clusters[0].pose, HERE) < 0.2
    belief.propagate(STEP)
    belief.update(measured(HERE))
    state = belief.state()
    assert far(state.clusters[0].pose, HERE) < 0.02
    assert state.status is Status.CONVERGED


@pytest.mark.parametrize("seed", range(4))
def test_a_pose_that_stays_elsewhere_wins_in_the_end(seed: int) -> None:
    """The robot was carried away: votes and measured poses agree on it."""
    belief = a_filter(seed=seed)
    for _ in range(5):
        belief.propagate(STEP)
        belief.update(measured(HERE))
    for _ in range(6):
        belief.propagate(STEP)
        belief.update(measured(THERE))
    assert far(belief.state().clusters[0].pose, THERE) < 0.05


def test_a_late_image_measures_where_the_robot_was() -> None:
    way = moved(0.6, 0.2, 0.4, 0.0, 0.0)
    now = HERE
    # The image was taken a way ahead of where the particles are.
    then = compose(now, way.increment)
    belief = a_filter()
    for _ in range(5):
        belief.propagate(STEP)
        belief.update(measured(then), way)
    assert far(belief.state().clusters[0].pose, now) < 0.02


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_any_share_of_measured_particles_keeps_the_weights_finite(share: float) -> None:
    belief = a_filter(measured_share=share)
    for _ in range(4):
        belief.propagate(STEP)
        belief.update(measured(HERE))
    assert (belief.weights > 0.0).all()
    assert np.isfinite(belief.weights).all()
    # Votes alone are blunt.
    assert far(belief.state().clusters[0].pose, HERE) < 0.5


def test_an_endless_covariance_says_nothing() -> None:
    """As of an image that shares no pixel with the view at its pose."""
    nothing = PoseMeasurement(HERE, 2.5e6 * np.eye(3), np.zeros(2), Agreement(0.0, np.full(24, np.nan), 0.0))
    belief = a_filter()
    for _ in range(5):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE).with_measurement(nothing))
    # Votes alone are blunt.
    assert far(belief.state().clusters[0].pose, HERE) < 0.5

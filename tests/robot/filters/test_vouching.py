"""Images that doubt themselves do not add up to a sure belief, whatever an image that is sure of another pose said between them."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.fields import hills, moved
from oracles.scenes import grid

from panoloc_mcl.robot.filters import MonteCarloFilter, Start, Status
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings, StatusSettings

PLACES = Places(grid(6, 5))
HERE, THERE = np.array([1.3, 1.6, 0.5]), np.array([4.0, 3.0, -2.5])
COVARIANCE = np.diag([0.004, 0.004, np.radians(0.1)]) ** 2


def image_of(pose: np.ndarray, confidence: float, noisy: bool = False):
    measured = PoseMeasurement(pose, COVARIANCE, np.zeros(2), Agreement(0.9, np.full(24, 0.9), 0.9))
    return replace(hills(PLACES, pose), noisy=noisy).with_measurement(measured).judged(confidence, "")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("before", [0, 1, 3])
@pytest.mark.parametrize("confidence", [0.76, 0.8, 0.9, 0.99])
def test_a_sure_image_stands_behind_its_own_pose_only(seed: int, before: int, confidence: float) -> None:
    belief = MonteCarloFilter(PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(seed))
    doubtful, sure = image_of(THERE, 0.5), image_of(HERE, confidence)
    for image in (*[doubtful] * before, sure, *[doubtful] * 6):
        belief.propagate(moved(0.0, 0.0, 0.0))
        belief.update(image)
        state = belief.state()
        if state.status is Status.CONVERGED:
            assert np.hypot(*(state.clusters[0].pose - HERE)[:2]) < 0.5


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("doubtful", [1, 2, 4])
def test_who_was_led_astray_by_doubt_is_not_sure_when_images_say_nothing(seed: int, doubtful: int) -> None:
    belief = MonteCarloFilter(PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(seed))
    black = silent_field(hills(PLACES).headings, PLACES, "image is black", full_circle=True)
    sure, wrong = image_of(HERE, 0.97), image_of(THERE, 0.6)
    for image in (sure, sure, *[wrong] * doubtful, black, black):
        belief.propagate(moved(0.3, 0.0, 0.0))
        belief.update(image)
        state = belief.state()
        if state.status is Status.CONVERGED:
            assert np.hypot(*(state.clusters[0].pose - THERE)[:2]) > 1.0


def test_a_sure_image_is_believed_at_once() -> None:
    belief = MonteCarloFilter(PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(0))
    belief.update(image_of(HERE, 0.95))
    assert belief.state().status is Status.CONVERGED


@pytest.mark.parametrize("seed", range(4))
def test_an_image_tells_how_far_it_speaks_for_the_belief(seed: int) -> None:
    """A doubtful one of here speaks for it though it does not vouch; one of elsewhere does not, and if it is sure nothing does."""

    def told(pose: np.ndarray, confidence: float):
        belief = MonteCarloFilter(
            PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(seed)
        )
        for _ in range(3):
            belief.propagate(moved(0.3, 0.0, 0.0))
            belief.update(image_of(HERE, 0.97))
        belief.propagate(moved(0.1, 0.0, 0.0))
        belief.update(image_of(pose, confidence))
        return belief.state()

    ahead = HERE + 0.02 * np.array([np.cos(HERE[2]), np.sin(HERE[2]), 0.0])
    assert told(ahead, 0.97).vouches
    doubtful = told(ahead, 0.3)
    assert not doubtful.vouches
    assert doubtful.backing > 100.0
    astray = told(THERE, 0.3)
    assert not astray.vouches
    assert astray.backing < 1.0
    assert told(THERE, 0.6).backing < astray.backing


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("second", ["noisy", "clear"])
def test_an_image_of_more_noise_than_world_needs_a_second_one(seed: int, second: str) -> None:
    belief = MonteCarloFilter(PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(seed))
    belief.update(image_of(HERE, 0.95, noisy=True))
    assert belief.state().status is Status.SEARCHING
    assert np.hypot(*(belief.state().clusters[0].pose - HERE)[:2]) < 0.1
    belief.propagate(moved(0.3, 0.0, 0.0))
    ahead = HERE + 0.3 * np.array([np.cos(HERE[2]), np.sin(HERE[2]), 0.0])
    belief.update(image_of(ahead, 0.9, noisy=second == "noisy"))
    assert belief.state().status is Status.CONVERGED


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("confidence", [0.76, 0.9, 0.99])
def test_two_images_of_noise_that_do_not_agree_make_nothing_sure(seed: int, confidence: float) -> None:
    belief = MonteCarloFilter(PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(seed))
    for pose in (HERE, THERE):
        belief.update(image_of(pose, confidence, noisy=True))
        assert belief.state().status is not Status.CONVERGED
        belief.propagate(moved(0.3, 0.0, 0.0))


@pytest.mark.parametrize("noisy", [False, True])
def test_who_was_carried_off_into_the_dark_is_sure_an_image_later(noisy: bool) -> None:
    belief = MonteCarloFilter(PLACES, Start(), MonteCarloSettings(particles=500), StatusSettings(), np.random.default_rng(0))
    statuses = []
    for pose in (HERE, HERE, THERE, THERE, THERE):
        belief.update(image_of(pose, 0.97, noisy=noisy and pose is THERE))
        belief.propagate(moved(0.01, 0.0, 0.0))
        statuses.append(belief.state().status)
    assert statuses[:3] == [Status.CONVERGED, Status.CONVERGED, Status.LOST]
    assert statuses[3:] == [Status.SEARCHING if noisy else Status.CONVERGED, Status.CONVERGED]

"""The frame of surveys whose errors are independent, and of those whose errors add up."""

import numpy as np
import pytest

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.map.survey_frame import SurveyFrame

COUNT = 36
ALL = np.ones(COUNT, dtype=np.bool_)


def a_survey() -> np.ndarray:
    """Rows of a grid, one after the other, as a survey lists them."""
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(COUNT)])


def dead_reckoning(truth: np.ndarray, rng: np.random.Generator, turn: float, step: float = 0.0) -> np.ndarray:
    """Poses that follow each other by steps, each of which turns and lies aside by a little for the root of a metre."""
    steps = between(truth[:-1], truth[1:])
    root = np.sqrt(np.hypot(steps[:, 0], steps[:, 1]))
    turns = turn * root * rng.standard_normal(len(steps))
    poses = [truth[0]]
    for pose, turned, aside in zip(steps, turns, step * root[:, None] * rng.standard_normal((len(steps), 2)), strict=True):
        # The turn happens along the way.
        halfway = np.array([0.0, 0.0, 0.5 * turned])
        moved = compose(compose(halfway, pose + np.append(aside, 0.0)), halfway)
        poses.append(compose(poses[-1], moved))
    return np.array(poses)


def as_mended(given: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The truth moved as a whole to where it fits the given poses best: all that images and a mean over the survey tell."""
    turn = float(np.mean(wrap_angle(given[:, 2] - truth[:, 2])))
    cos, sin = np.cos(turn), np.sin(turn)
    centre = truth[:, :2].mean(axis=0)
    positions = (truth[:, :2] - centre) @ np.array([[cos, sin], [-sin, cos]]) + given[:, :2].mean(axis=0)
    return np.column_stack([positions, truth[:, 2] + turn])


@pytest.mark.parametrize("seed", range(10))
def test_independent_errors_are_no_drift(seed):
    rng, truth = np.random.default_rng(seed), a_survey()
    given = truth + rng.standard_normal(truth.shape) * [0.05, 0.05, np.radians(2.0)]
    assert SurveyFrame.of_drift(given, as_mended(given, truth), ALL) is None


def test_exact_poses_are_no_drift():
    assert SurveyFrame.of_drift(a_survey(), a_survey(), ALL) is None


def test_too_few_poses_say_nothing():
    truth = a_survey()
    given = dead_reckoning(truth, np.random.default_rng(0), 0.02)
    assert SurveyFrame.of_drift(given, truth, np.arange(COUNT) < 8) is None


def test_a_map_of_dead_reckoning_keeps_to_where_it_began():
    """And claims what it is off by: thirty surveys, each with a frame of its own."""
    truth, squares, before, after = a_survey(), [], [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        given = dead_reckoning(truth, rng, 0.01, 0.005) + rng.standard_normal(truth.shape) * [0.003, 0.003, 0.001]
        mended = as_mended(given, truth)
        frame = SurveyFrame.of_drift(given, mended, ALL)
        assert frame is not None
        moved = frame.moved(mended)
        off = moved - truth
        squares.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(frame.errors_at(moved[:, :2])), off).mean() / 3.0)
        before.append(np.hypot(*(mended - truth)[:, :2].T).mean())
        after.append(np.hypot(*off[:, :2].T).mean())
        assert "dead reckoning" in frame.note
    assert np.median(after) < 0.25 * np.median(before)
    assert 0.3 < np.mean(squares) < 3.0


def test_one_reference_that_is_far_off_is_not_where_the_survey_began():
    """It is left out of what is told."""
    truth = a_survey()
    given = dead_reckoning(truth, np.random.default_rng(3), 0.01)
    mended = as_mended(given, truth)
    expected = SurveyFrame.of_drift(given[1:], mended[1:], ALL[1:])
    given[0] = [7.0, 9.0, 2.0]
    found = SurveyFrame.of_drift(given, mended, np.arange(COUNT) > 0)
    assert expected is not None
    assert found is not None
    assert found.moved(mended) == pytest.approx(expected.moved(mended))


def test_covariances_turn_with_the_frame():
    frame = SurveyFrame(np.array([1.0, 0.0, np.pi / 2.0]), np.zeros(2), np.zeros((3, 3)))
    turned = frame.turned(np.diag([4.0, 1.0, 0.1])[None])[0]
    assert turned == pytest.approx(np.diag([1.0, 4.0, 0.1]))
    assert frame.moved(np.array([[1.0, 0.0, 0.0]]))[0] == pytest.approx([1.0, 1.0, np.pi / 2.0])

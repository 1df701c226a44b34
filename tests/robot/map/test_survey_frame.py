"""The frame of surveys whose errors are independent, and of those whose errors add up."""

import numpy as np
import pytest

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Edges
from panoloc_mcl.robot.map.pairs import neighbour_pairs
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.map.survey_frame import SurveyFrame, as_it_drifts, far_off_alone

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
    frame = SurveyFrame(np.array([1.0, 0.0, np.pi / 2.0]), np.zeros(2), np.zeros((3, 3)), np.zeros(4))
    turned = frame.turned(np.diag([4.0, 1.0, 0.1])[None])[0]
    assert turned == pytest.approx(np.diag([1.0, 4.0, 0.1]))
    assert frame.moved(np.array([[1.0, 0.0, 0.0]]))[0] == pytest.approx([1.0, 1.0, np.pi / 2.0])


def test_ways_are_as_sure_as_the_survey():
    truth, squares = a_survey(), []
    for seed in range(20):
        given = dead_reckoning(truth, np.random.default_rng(seed), 0.01, 0.005)
        frame = SurveyFrame.of_drift(given, as_mended(given, truth), ALL)
        assert frame is not None
        ways = frame.as_odometry(given, ALL)
        assert (ways.kinds == ODOMETRY).all()
        off = ways.measured - between(truth[ways.first], truth[ways.second])
        squares.append(np.einsum("mi,mij,mj->m", off, np.linalg.inv(ways.covariances), off).mean() / 3.0)
    assert 0.3 < np.median(squares) < 1.5


def test_ways_leave_out_what_is_far_off():
    given = dead_reckoning(a_survey(), np.random.default_rng(1), 0.01, 0.005)
    told = ALL.copy()
    told[[0, 7]] = False
    frame = SurveyFrame.of_drift(given, as_mended(given, a_survey()), told)
    assert frame is not None
    ways = frame.as_odometry(given, told)
    assert len(ways) == COUNT - 3
    assert not np.isin([0, 7], np.concatenate([ways.first, ways.second])).any()
    assert [6, 8] in np.column_stack([ways.first, ways.second]).tolist()


def images_of(truth: np.ndarray, rng: np.random.Generator) -> Edges:
    """Two rooms of a grid, which hardly see each other: one pair of images joins them."""
    pairs = neighbour_pairs(truth[:, :2], 6, 1.6)
    apart = (truth[pairs[:, 0], 0] < 2.5) != (truth[pairs[:, 1], 0] < 2.5)
    door = np.flatnonzero(apart & (truth[pairs[:, 0], 1] < 1.5) & (truth[pairs[:, 1], 1] < 1.5))
    keep = ~apart
    keep[door] = True
    pairs = pairs[keep]
    noise = rng.standard_normal((len(pairs), 3)) * [0.005, 0.005, 0.001]
    covariances = np.broadcast_to(np.diag([0.005**2, 0.005**2, 0.001**2]), (len(pairs), 3, 3))
    return Edges.of(pairs, between(truth[pairs[:, 0]], truth[pairs[:, 1]]) + noise, covariances)


def bent(poses: np.ndarray, truth: np.ndarray) -> float:
    """How far poses are off at most, once they lie on the truth as a whole, metres."""
    return float(np.hypot(*(as_mended(poses, truth)[:, :2] - poses[:, :2]).T).max())


# Not 3, which drifts so little that it fits the images as it is.
@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_a_survey_that_drifts_does_not_bend_the_map(seed):
    rng, grid = np.random.default_rng(seed), a_survey()
    # Column by column, so that one room is surveyed after the other.
    truth = grid[np.argsort(grid[:, 0], kind="stable")]
    given, edges = dead_reckoning(truth, rng, 0.04, 0.01), images_of(truth, rng)
    # Held at places that are said to be sure to a centimetre and half a degree.
    as_places = solve(given, edges, Priors(given, np.tile([0.01, np.radians(0.5)], (COUNT, 1)), robust=False))
    assert bent(as_places.poses, truth) > 0.02
    drifting, frame = as_it_drifts(as_places, given, ALL)
    assert frame is not None
    assert len(drifting.edges) == len(edges)
    assert bent(drifting.poses, truth) < 0.015
    # It lies where the survey began, until the frame is placed.
    np.testing.assert_allclose(drifting.poses[0], given[0], atol=1e-3)


def test_a_survey_that_does_not_drift_is_solved_as_before():
    rng, truth = np.random.default_rng(3), a_survey()
    given = truth + rng.standard_normal(truth.shape) * [0.05, 0.05, np.radians(2.0)]
    before = solve(given, images_of(truth, rng), Priors(given, np.full((COUNT, 2), np.nan)))
    after, frame = as_it_drifts(before, given, ALL)
    assert after is before
    assert frame is None


def test_what_is_far_off_alone_is_told_from_a_drift():
    rng, truth = np.random.default_rng(5), a_survey()
    given, edges = dead_reckoning(truth, rng, 0.04, 0.01), images_of(truth, rng)
    assert not far_off_alone(given, truth, edges).any()
    wrong = given.copy()
    wrong[9, :2] += [1.5, -1.0]
    wrong[20, 2] += 2.5
    np.testing.assert_array_equal(np.flatnonzero(far_off_alone(wrong, truth, edges)), [9, 20])
    # Where no images bear each other out, nobody knows.
    assert not far_off_alone(wrong, truth, Edges.none()).any()

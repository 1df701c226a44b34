"""The pose graph on graphs whose answer is known."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.integrate import quad
from scipy.stats import chi2

from panoloc_mcl.robot.geometry import angle_difference, between, compose
from panoloc_mcl.robot.map import pose_graph
from panoloc_mcl.robot.map.keyframes import LOOP, ODOMETRY, Edges
from panoloc_mcl.robot.map.pose_graph import CommonErrors, Priors, solve

SD = np.array([0.004, 0.004, np.radians(0.05)])


def a_grid(rng: np.random.Generator, columns: int = 5, rows: int = 4) -> np.ndarray:
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.column_stack([x.ravel(), y.ravel(), rng.uniform(-np.pi, np.pi, columns * rows)]).astype(float)


def measured(truth: np.ndarray, rng: np.random.Generator, sd: np.ndarray = SD, reach: float = 1.5) -> Edges:
    apart = np.hypot(*(truth[:, None, :2] - truth[None, :, :2]).T).T
    pairs = np.argwhere((apart < reach) & (apart > 0.0))
    relative = between(truth[pairs[:, 0]], truth[pairs[:, 1]]) + rng.standard_normal((len(pairs), 3)) * sd
    return Edges.of(pairs, relative, np.broadcast_to(np.diag(SD**2), (len(pairs), 3, 3)))


def unknown(count: int) -> np.ndarray:
    return np.full((count, 2), np.nan)


def rms(poses: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1))))


def test_errors_of_given_poses_and_of_measurements_are_estimated():
    rng = np.random.default_rng(0)
    truth = a_grid(rng, 8, 6)
    noise = np.array([0.05, 0.05, np.radians(2.0)])
    given = truth + rng.standard_normal(truth.shape) * noise
    found = solve(given, measured(truth, rng, 2.0 * SD), Priors(given, unknown(len(truth))))
    assert found.prior_sds[0] == pytest.approx(0.05, rel=0.25)
    assert found.prior_sds[1] == pytest.approx(np.radians(2.0), rel=0.25)
    assert found.scale == pytest.approx(2.0, rel=0.2)


def test_what_the_loss_costs_is_that_of_normal_errors() -> None:
    def mean(of: Callable[[float], float], below: float = 200.0) -> float:
        return float(quad(lambda q: of(q) * chi2.pdf(q, 3), 0.0, below)[0])

    bound = pose_graph._USUAL
    weight, slope = (lambda q: (bound / (bound + q)) ** 2), (lambda q: -2.0 * bound**2 / (bound + q) ** 3)
    sensitivity = mean(lambda q: weight(q) + 2.0 / 3.0 * q * slope(q))
    worth = sensitivity**2 / mean(lambda q: q * weight(q) ** 2 / 3.0)
    assert worth == pytest.approx(pose_graph._WORTH, abs=1e-3)
    last = bound * (pose_graph._COUNTED**-0.5 - 1.0)
    left = mean(lambda q: q / 3.0, last) / mean(lambda q: 1.0, last)
    assert left == pytest.approx(pose_graph._LEFT, abs=1e-3)


@pytest.mark.slow
def test_the_frame_of_many_surveys_is_as_far_off_as_is_claimed() -> None:
    """All poses share the error of the given ones together: one number a survey."""
    rng = np.random.default_rng(7)
    truth, noise = a_grid(rng, 7, 6), np.array([0.05, 0.05, np.radians(2.0)])
    offs, claims, sds = [], [], []
    for _ in range(60):
        given = truth + rng.standard_normal(truth.shape) * noise
        found = solve(given, measured(truth, rng), Priors(given, unknown(len(truth))))
        offs.append(float(np.mean(angle_difference(found.poses[:, 2], truth[:, 2]))))
        claims.append(float(np.mean(found.covariances[:, 2, 2])))
        sds.append(found.prior_sds / noise[1:])
    assert np.mean(sds, axis=0) == pytest.approx(1.0, abs=0.03)
    assert np.sqrt(np.mean(claims)) == pytest.approx(np.sqrt(np.mean(np.square(offs))), rel=0.1)


def test_exact_poses_are_found_to_be_exact():
    rng = np.random.default_rng(1)
    truth = a_grid(rng)
    found = solve(truth, measured(truth, rng), Priors(truth, unknown(len(truth))))
    # Well below the 4 mm that a measurement errs.
    assert found.prior_sds[0] < 0.002
    assert rms(found.poses, truth) < 0.0015


def test_wrong_measurements_and_a_wrong_given_pose_weigh_nothing():
    rng = np.random.default_rng(2)
    truth = a_grid(rng)
    given = truth + rng.standard_normal(truth.shape) * [0.02, 0.02, 0.02]
    given[7, :2] += [1.0, -0.5]
    edges = measured(truth, rng)
    wrong = rng.permutation(len(edges))[: len(edges) // 8]
    edges.measured[wrong] += rng.uniform(0.2, 1.0, (len(wrong), 3)) * rng.choice([-1.0, 1.0], (len(wrong), 3))
    found = solve(given, edges, Priors(given, unknown(len(truth))))
    assert found.prior_weights[7] < 0.05
    assert found.edges.weights[wrong].max() < 0.05
    assert np.median(np.delete(found.edges.weights, wrong)) > 0.5
    assert np.hypot(*(found.poses - truth)[7, :2]) < 0.03


def test_covariances_say_how_far_poses_are_off():
    squares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        truth = a_grid(rng, 4, 3)
        given = truth + rng.standard_normal(truth.shape) * [0.03, 0.03, 0.03]
        found = solve(given, measured(truth, rng), Priors(given, np.broadcast_to([0.03, 0.03], (12, 2))))
        away = found.poses - truth
        away[:, 2] = angle_difference(found.poses[:, 2], truth[:, 2])
        squares.append(np.einsum("ni,nij,nj->n", away, np.linalg.inv(found.covariances), away))
    # Three unknowns: the mean of a chi squared with three degrees of freedom.
    assert 2.0 < np.mean(squares) < 4.5


def test_false_loops_do_not_bend_a_drive():
    right_lost = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        angle = np.linspace(0.0, 4.0 * np.pi, 80)
        truth = np.column_stack([3.0 * np.cos(angle), 3.0 * np.sin(angle), angle + np.pi / 2])
        steps = between(truth[:-1], truth[1:]) + rng.standard_normal((79, 3)) * [0.02, 0.02, 0.01]
        start = [truth[0]]
        for step in steps:
            start.append(compose(start[-1], step))
        chain = np.column_stack([np.arange(79), np.arange(1, 80)])
        odometry = Edges.of(chain, steps, np.broadcast_to(np.diag([0.02**2, 0.02**2, 0.01**2]), (79, 3, 3)), ODOMETRY)
        pairs = np.column_stack([np.arange(0, 40, 2), np.arange(0, 40, 2) + 40])
        met = between(truth[pairs[:, 0]], truth[pairs[:, 1]]) + rng.standard_normal((20, 3)) * SD
        false = rng.random(20) < 0.2
        met[false] += rng.uniform(-2.0, 2.0, (int(false.sum()), 3))
        loops = Edges.of(pairs, met, np.broadcast_to(np.diag(SD**2), (20, 3, 3)), LOOP)
        sds = np.full((80, 2), np.inf)
        sds[0] = 1e-4
        found = solve(np.array(start), odometry.joined(loops), Priors(truth, sds, robust=False))
        weights = found.edges.weights[79:]
        assert weights[false].max(initial=0.0) < 0.1
        right_lost += int(np.sum(weights[~false] < 0.3))
        assert rms(found.poses, truth) < 0.7 * rms(np.array(start), truth)
    assert right_lost <= 2


@settings(max_examples=5, deadline=None)
@given(st.floats(-50.0, 50.0), st.floats(-3.0, 3.0))
def test_the_frame_does_not_matter(far: float, turn: float):
    rng = np.random.default_rng(4)
    truth = a_grid(rng, 4, 3)
    given = truth + rng.standard_normal(truth.shape) * [0.03, 0.03, 0.03]
    edges = measured(truth, rng)
    here = solve(given, edges, Priors(given, unknown(12)))
    moved = compose(np.array([far, -far, turn]), given)
    there = solve(moved, edges, Priors(moved, unknown(12)))
    expected = compose(np.array([far, -far, turn]), here.poses)
    np.testing.assert_allclose(there.poses[:, :2], expected[:, :2], atol=1e-6)
    np.testing.assert_allclose(angle_difference(there.poses[:, 2], expected[:, 2]), 0.0, atol=1e-6)


def a_round(rng: np.random.Generator, turn: float) -> tuple[np.ndarray, np.ndarray, Edges, CommonErrors]:
    """Twice round a circle: the truth, where dead reckoning ends, and steps and loops that all turn too far with the way ahead."""
    angle = np.linspace(0.0, 4.0 * np.pi, 60)
    truth = np.column_stack([2.0 * np.cos(angle), 2.0 * np.sin(angle), angle + np.pi / 2])
    pairs = [(i, j) for i in range(60) for j in (i - 2, i - 1, i + 1, i + 2) if 0 <= j < 60]
    pairs += [(i, i + 29) for i in range(0, 30, 3)]
    first, second = np.array(pairs).T
    relative = between(truth[first], truth[second])
    relative[:, 2] += turn * relative[:, 0]
    relative += rng.standard_normal(relative.shape) * SD
    edges = Edges.of(np.array(pairs), relative, np.broadcast_to(np.diag(SD**2), (len(pairs), 3, 3)))
    start = [truth[0]]
    for i in range(59):
        start.append(compose(start[-1], relative[pairs.index((i, i + 1))]))
    effects = np.zeros((len(pairs), 3, 1))
    effects[:, 2, 0] = relative[:, 0]
    common = CommonErrors(sparse.csc_matrix(effects.reshape(-1, 1)), np.array([np.radians(0.5)]))
    return truth, np.array(start), edges, common


def test_a_turn_that_all_measurements_have_in_common_is_found_where_ways_close():
    better = []
    for seed in range(4):
        truth, start, edges, common = a_round(np.random.default_rng(seed), np.radians(0.4))
        sds = np.full((60, 2), np.inf)
        sds[0] = 1e-4
        priors = Priors(truth, sds, robust=False)
        without, found = solve(start, edges, priors), solve(start, edges, priors, common=common)
        better.append(rms(found.poses, truth) / rms(without.poses, truth))
    assert max(better) < 0.7


def test_poses_are_no_surer_than_errors_in_common_allow():
    squares: list[float] = []
    alone: list[float] = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        truth, start, edges, common = a_round(rng, float(rng.normal(0.0, np.radians(0.5))))
        # Nothing closes: only the steps of the first round.
        steps = edges.chosen((np.abs(edges.second - edges.first) == 1) & (np.maximum(edges.first, edges.second) < 25))
        rows = np.flatnonzero((np.abs(edges.second - edges.first) == 1) & (np.maximum(edges.first, edges.second) < 25))
        effects = common.effects[(3 * rows[:, None] + np.arange(3)).ravel()]
        sds = np.full((25, 2), np.inf)
        sds[0] = 1e-4
        priors = Priors(truth[:25], sds, robust=False)
        for collected, errors in ((squares, CommonErrors(sparse.csc_matrix(effects), common.sds)), (alone, None)):
            found = solve(start[:25], steps, priors, common=errors)
            away = float(angle_difference(found.poses[-1, 2], truth[24, 2]))
            collected.append(away**2 / found.covariances[-1, 2, 2])
    assert 0.3 < np.mean(squares) < 2.5
    assert np.mean(alone) > 10.0

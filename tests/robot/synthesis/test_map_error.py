from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import UNKNOWN, SourceErrors, ViewSynthesizer, learn_source_errors
from panoloc_mcl.robot.synthesis.map_error import Trial, explain
from panoloc_mcl.robot.synthesis.source_errors import sharpness_of

SCATTER = np.diag([0.001, 0.001, np.radians(0.02)]) ** 2
# Of panoramas of one column a degree, in a hall with walls four metres away.
PIXELS = np.array([180.0 / np.pi / 4.0, 180.0 / np.pi])


def truth_of(**kinds: np.ndarray) -> SourceErrors:
    """Exact but for what is named."""
    parts = {"of_views": np.ones(2), "of_pose": np.zeros(2), "to_one_side": np.zeros(2)} | kinds
    return SourceErrors(**parts, sharpness=sharpness_of(float(np.hypot(*(PIXELS * parts["of_pose"])))), trials=1)


def trials_of(truth: SourceErrors, count: int, seed: int) -> list[Trial]:
    """Errors drawn as they are said to be, of one to four sources near and far; the image shows more or less of them."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        weights = rng.uniform(0.2, 1.0, int(rng.integers(1, 5)))
        weights /= weights.sum()
        offsets = rng.uniform(0.5, 2.0, len(weights))[:, None] * _directions(rng, len(weights))
        scatter = SCATTER * rng.uniform(0.3, 3.0)
        own = np.diag([truth.of_pose[0], truth.of_pose[0], truth.of_pose[1]]) ** 2
        covariance = truth.of_image(scatter) + truth.of_sources(weights, offsets) + own
        error = np.sqrt(np.diag(covariance)) * rng.standard_normal(3)
        out.append(Trial(error, scatter, weights, offsets))
    return out


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("of_views", np.array([4.0, 9.0])),
        ("of_pose", np.array([0.02, np.radians(1.0)])),
        ("of_pose", np.array([0.002, np.radians(0.1)])),
        ("to_one_side", np.array([0.02, np.radians(1.0)])),
    ],
)
@pytest.mark.parametrize("seed", range(1))
def test_what_errors_come_from_is_told_by_how_they_grow(kind: str, size: np.ndarray, seed: int) -> None:
    truth = truth_of(**{kind: size})
    learnt = explain(trials_of(truth, 200, seed), PIXELS)
    assert learnt.trials == 200
    # A pose among four sources around it, and one beside a single source; an image that shows much of its errors, and one of little.
    for weights, offsets in (
        (np.full(4, 0.25), 0.6 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])),
        (np.ones(1), np.array([[0.8, 0.3]])),
    ):
        for scatter in (0.5 * SCATTER, 2.0 * SCATTER):
            claimed, due = (
                np.sqrt(np.diag(errors.of_image(scatter) + errors.of_sources(weights, offsets))) for errors in (learnt, truth)
            )
            # Student's t claims a little more than normal errors need.
            # Nor is the reference's own pose known, as depths hide some of it.
            assert np.all(claimed < 1.5 * due + [0.002, 0.002, np.radians(0.05)])
            assert np.all(claimed > 0.7 * due)


def test_errors_with_heavy_tails_widen_the_claim() -> None:
    # Far heavier tails than those of the distribution that is fitted.
    rng = np.random.default_rng(4)
    trials = []
    for trial in trials_of(truth_of(), 300, 1):
        tail = np.sqrt(rng.chisquare(2.0) / 2.0)
        trials.append(trial._replace(error=trial.error / tail))
    learnt = explain(trials, PIXELS)
    inside = []
    for trial in trials:
        own = np.diag([learnt.of_pose[0], learnt.of_pose[0], learnt.of_pose[1]]) ** 2
        covariance = learnt.of_image(trial.shown) + learnt.of_sources(trial.weights, trial.offsets) + own
        inside.append(trial.error[:2] @ np.linalg.solve(covariance[:2, :2], trial.error[:2]) <= 4.0)
    assert 0.78 < np.mean(inside) < 0.93


@pytest.mark.slow
def test_one_wild_trial_is_not_believed() -> None:
    trials = trials_of(truth_of(of_pose=np.array([0.002, 0.001])), 100, 0)
    wild = Trial(np.array([0.25, 0.1, 0.1]), SCATTER, np.ones(1), np.zeros((1, 2)))
    sober, shaken = (explain(some, PIXELS).of_sources(np.ones(1), np.zeros((1, 2))) for some in (trials, [*trials, wild]))
    assert shaken[0, 0] < 2.0 * sober[0, 0]


def test_sources_that_contradict_each_other_do_not_average_out() -> None:
    four, beside = np.array([0.4, 0.2, 0.2, 0.2]), np.zeros((4, 2))
    for sd, least, most in ((0.001, 0.5, 0.6), (0.1, 0.95, 1.001)):
        errors = truth_of(of_pose=np.array([sd, sd]))
        assert least * sd < np.sqrt(errors.of_sources(four, beside)[0, 0]) < most * sd


def test_from_too_few_trials_nothing_is_learnt_and_it_is_said() -> None:
    guess = explain(trials_of(UNKNOWN, 5, 0), PIXELS)
    assert guess.trials == 0
    (note,) = guess.notes
    assert "2 cm and 0.5 degrees" in note
    assert not explain(trials_of(UNKNOWN, 50, 0), PIXELS).notes


@given(
    weights=st.lists(st.floats(0.05, 1.0), min_size=1, max_size=6),
    seed=st.integers(0, 1000),
)
@settings(max_examples=50, deadline=None)
def test_covariances_are_symmetric_positive_and_smaller_among_near_sources(weights: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    shared = np.array(weights) / np.sum(weights)
    offsets = rng.uniform(0.2, 2.0, len(weights))[:, None] * _directions(rng, len(weights))
    errors = SourceErrors(np.ones(2), np.array([0.01, 0.02]), np.array([0.03, 0.01]), 0.5, 1)
    far, near = errors.of_sources(shared, offsets), errors.of_sources(shared, 0.5 * offsets)
    assert np.array_equal(far, far.T)
    assert np.linalg.eigvalsh(near).min() > 0.0
    assert np.all(np.diag(near) < np.diag(far))


@pytest.mark.parametrize("values", [None, np.zeros(3), np.full(7, 0.1), np.full(8, np.nan), np.full(8, -1.0)])
def test_what_is_no_standard_deviation_becomes_the_stated_guess(values: np.ndarray | None) -> None:
    restored = SourceErrors.of_array(values)
    assert restored.trials == 0
    assert np.array_equal(restored.of_pose, UNKNOWN.of_pose)


def test_what_was_learnt_comes_back_from_a_file() -> None:
    errors = SourceErrors(np.array([2.0, 3.0]), np.array([0.03, 0.04]), np.array([0.05, 0.06]), 0.3, 80)
    assert np.array_equal(SourceErrors.of_array(errors.array()).array(), errors.array())


def test_references_that_stand_where_they_are_said_to_are_told_from_such_that_do_not(small) -> None:
    """The same room: as it is, and with every reference moved by 8 cm in a direction of its own."""
    exact = small.exact
    rng = np.random.default_rng(1)
    moved = replace(exact.references, positions=exact.references.positions + 0.08 * _directions(rng, len(exact.references)))
    off = ViewSynthesizer(moved, exact.profiles, exact.camera_height_m)
    claimed = [learn_source_errors(one, VotesSettings(), 16).of_sources(np.ones(1), np.zeros((1, 2))) for one in (exact, off)]
    sds = [np.sqrt(one[0, 0]) for one in claimed]
    assert sds[0] < 0.02
    assert 0.03 < sds[1] < 0.12

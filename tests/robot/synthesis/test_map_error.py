from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import UNKNOWN, SourceErrors, ViewSynthesizer, learn_source_errors
from panoloc_mcl.robot.synthesis.map_error import Trial, explain
from panoloc_mcl.robot.synthesis.source_errors import shares

CLAIMED = np.diag([0.001, 0.001, np.radians(0.02)]) ** 2


def trials_of(truth: SourceErrors, count: int, seed: int) -> list[Trial]:
    """Errors drawn as they are said to be, of one or four sources near and far."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        sources = int(rng.choice([1, 4]))
        offsets = rng.uniform(0.5, 2.0, sources)[:, None] * _directions(rng, sources)
        kinds = shares(np.full(sources, 1.0 / sources), offsets) + np.array([1.0, 0.0, 0.0])
        variances = kinds @ np.square([truth.of_pose, truth.to_one_side, truth.with_distance])
        sds = np.sqrt(np.array([variances[0], variances[0], variances[1]]) + np.diag(CLAIMED))
        out.append(Trial(sds * rng.standard_normal(3), CLAIMED, kinds))
    return out


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


@pytest.mark.parametrize("kind", ["of_pose", "to_one_side", "with_distance"])
@pytest.mark.parametrize("seed", range(3))
def test_what_errors_come_from_is_told_by_how_they_grow(kind: str, seed: int) -> None:
    none = {"of_pose": np.zeros(2), "to_one_side": np.zeros(2), "with_distance": np.zeros(2)}
    truth = SourceErrors(**{**none, kind: np.array([0.02, np.radians(1.0)])}, trials=1)
    learnt = explain(trials_of(truth, 400, seed))
    assert learnt.trials == 400
    # A pose among four sources around it, and one beside a single source.
    for weights, offsets in (
        (np.full(4, 0.25), 0.6 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])),
        (np.ones(1), np.array([[0.8, 0.3]])),
    ):
        claimed, due = (np.sqrt(np.diag(errors.covariance(weights, offsets))) for errors in (learnt, truth))
        # Student's t claims a little more than normal errors need.
        assert np.all(claimed < 1.4 * due + [0.003, 0.003, np.radians(0.1)])
        assert np.all(claimed > 0.75 * due)


def test_one_wild_trial_is_not_believed() -> None:
    trials = trials_of(SourceErrors(np.array([0.002, 0.001]), np.zeros(2), np.zeros(2), 1), 100, 0)
    wild = Trial(np.array([0.25, 0.1, 0.1]), CLAIMED, trials[0].shares)
    sober, shaken = (explain(some).covariance(np.ones(1), np.zeros((1, 2))) for some in (trials, [*trials, wild]))
    assert shaken[0, 0] < 2.0 * sober[0, 0]


def test_from_too_few_trials_nothing_is_learnt_and_it_is_said() -> None:
    guess = explain(trials_of(UNKNOWN, 5, 0))
    assert guess.trials == 0
    (note,) = guess.notes
    assert "2 cm and 0.5 degrees" in note
    assert not explain(trials_of(UNKNOWN, 50, 0)).notes


@given(
    weights=st.lists(st.floats(0.05, 1.0), min_size=1, max_size=6),
    seed=st.integers(0, 1000),
)
@settings(max_examples=50, deadline=None)
def test_covariances_are_symmetric_positive_and_smaller_among_near_sources(weights: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    shared = np.array(weights) / np.sum(weights)
    offsets = rng.uniform(0.2, 2.0, len(weights))[:, None] * _directions(rng, len(weights))
    errors = SourceErrors(np.array([0.01, 0.02]), np.array([0.03, 0.01]), np.array([0.02, 0.01]), 1)
    far, near = errors.covariance(shared, offsets), errors.covariance(shared, 0.5 * offsets)
    assert np.array_equal(far, far.T)
    assert np.linalg.eigvalsh(near).min() > 0.0
    assert np.all(np.diag(near) < np.diag(far))


@pytest.mark.parametrize("values", [None, np.zeros(3), np.full(7, np.nan), np.full(7, -1.0)])
def test_what_is_no_standard_deviation_becomes_the_stated_guess(values: np.ndarray | None) -> None:
    restored = SourceErrors.of_array(values)
    assert restored.trials == 0
    assert np.array_equal(restored.of_pose, UNKNOWN.of_pose)


def test_what_was_learnt_comes_back_from_a_file() -> None:
    errors = SourceErrors(np.array([0.01, 0.02]), np.array([0.03, 0.04]), np.array([0.05, 0.06]), 80)
    assert np.array_equal(SourceErrors.of_array(errors.array()).array(), errors.array())


def test_references_that_stand_where_they_are_said_to_are_told_from_such_that_do_not(small) -> None:
    """The same room: as it is, and with every reference moved by 8 cm in a direction of its own."""
    exact = small.exact
    rng = np.random.default_rng(1)
    moved = replace(exact.references, positions=exact.references.positions + 0.08 * _directions(rng, len(exact.references)))
    off = ViewSynthesizer(moved, exact.profiles, exact.camera_height_m)
    claimed = [learn_source_errors(one, VotesSettings(), 16).covariance(np.ones(1), np.zeros((1, 2))) for one in (exact, off)]
    sds = [np.sqrt(one[0, 0]) for one in claimed]
    assert sds[0] < 0.02
    assert 0.03 < sds[1] < 0.12

"""Asking a filter changes nothing, whatever has happened before: two calls give one answer, and the filter goes on as if unasked."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.fields import STANDING, hills, moved
from oracles.scenes import grid

from panoloc_mcl.robot.filters import KalmanOrientationFilter, MonteCarloFilter, OdometryOnlyFilter, Start
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.observation.field import at_headings, silent_field
from panoloc_mcl.robot.settings.localizer import AdaptiveSettings, KalmanSettings, MonteCarloSettings, StatusSettings

PLACES = Places(grid(6, 5))
STATUS = StatusSettings()
POSES = {"here": np.array([1.3, 1.6, 0.5]), "there": np.array([4.0, 3.0, -2.5])}


def image_of(*names: str, doubt: float = 0.02, measured: bool = True):
    field = hills(PLACES, *(POSES[name] for name in names))
    if measured:
        covariance = np.diag([0.004, 0.004, np.radians(0.1)]) ** 2
        agreement = Agreement(0.9, np.full(24, 0.9), 0.9)
        field = field.with_measurement(PoseMeasurement(POSES[names[0]], covariance, np.zeros(2), agreement, 0.5 * covariance))
    return field.judged(1.0 - doubt, "")


IMAGES = {
    "here": image_of("here"),
    "there": image_of("there"),
    "both": image_of("here", "there", measured=False),
    "doubtful": image_of("there", doubt=0.5),
    "black": silent_field(hills(PLACES).headings, PLACES, "image is black", full_circle=True),
}
MOTIONS = {"stands": STANDING, "drives": moved(0.2, 0.0, 0.05), "noise": moved(0.0, 0.0, 0.0)}
histories = st.lists(
    st.tuples(st.sampled_from(sorted(MOTIONS)), st.sampled_from(sorted(IMAGES)), st.booleans(), st.integers(0, 3)),
    min_size=1,
    max_size=12,
)


def a_filter(kind: str, known: bool):
    start, rng = Start((1.2, 1.5), 0.4) if known else Start(), np.random.default_rng(3)
    if kind == "kalman":
        return KalmanOrientationFilter(PLACES, start, KalmanSettings(), STATUS, rng)
    if kind == "odometry":
        return OdometryOnlyFilter(PLACES, start, STATUS)
    adaptive = AdaptiveSettings(enabled=kind == "adaptive", min_particles=100, max_particles=600)
    return MonteCarloFilter(PLACES, start, MonteCarloSettings(particles=300, adaptive=adaptive), STATUS, rng)


def step(belief, motion: str, image: str, late: bool) -> None:
    belief.propagate(MOTIONS[motion])
    offset = moved(-0.1, 0.0, 0.0).reversed() if late else None
    headings = belief.heading_hypotheses(offset)
    votes = IMAGES[image]
    if headings is not None:
        asked = at_headings(votes.votes, headings)
        votes = type(votes)(asked, headings, PLACES, votes.tolerance, full_circle=False, problem=votes.problem)
    belief.update(votes, offset)


def answer(belief) -> str:
    state = belief.state()
    values = {name: value for name, value in vars(state).items() if name != "clusters"}
    clusters = [(c.pose.tolist(), c.covariance.tolist(), c.mass) for c in state.clusters]
    return json.dumps([clusters, {name: str(value) for name, value in values.items()}])


def kept(belief) -> str:
    arrays, header = belief.snapshot()
    return json.dumps([{name: array.tolist() for name, array in arrays.items()}, header])


@pytest.mark.parametrize("kind", ["particles", "adaptive", "kalman", "odometry"])
@given(history=histories, known=st.booleans())
@settings(max_examples=10, deadline=None)
def test_asking_twice_gives_one_answer_and_changes_nothing(kind: str, history: list, known: bool) -> None:
    asked, silent = a_filter(kind, known), a_filter(kind, known)
    for motion, image, late, times in history:
        for belief in (asked, silent):
            step(belief, motion, image, late)
        answers = [(answer(asked), kept(asked), asked.particles()[0].tobytes()) for _ in range(times)]
        assert len(set(answers)) <= 1
    assert kept(asked) == kept(silent)
    assert answer(asked) == answer(silent)


@pytest.mark.parametrize("kind", ["particles", "kalman", "odometry"])
@given(history=histories, known=st.booleans())
@settings(max_examples=8, deadline=None)
def test_a_filter_that_was_saved_and_restored_answers_as_before_and_goes_on(kind: str, history: list, known: bool) -> None:
    one, other = a_filter(kind, known), a_filter(kind, not known)
    for motion, image, late, _ in history:
        step(one, motion, image, late)
    arrays, header = one.snapshot()
    other.restore({name: array.copy() for name, array in arrays.items()}, json.loads(json.dumps(header)))
    assert answer(other) == answer(one)
    for belief in (one, other):
        step(belief, "drives", "here", False)
    assert kept(other) == kept(one)


@pytest.mark.parametrize("kind", ["particles", "kalman", "odometry"])
def test_a_state_of_an_older_form_is_refused_and_changes_nothing(kind: str) -> None:
    belief = a_filter(kind, True)
    step(belief, "drives", "here", False)
    arrays, header = belief.snapshot()
    before = kept(belief)
    for older in ({**header, "form": "particles/1"}, {k: v for k, v in header.items() if k != "form"}):
        with pytest.raises((KeyError, ValueError), match="form"):
            belief.restore(arrays, older)
    assert kept(belief) == before


@pytest.mark.parametrize(
    ("name", "value"), [("match", "much"), ("resampled", 1), ("step", 0.5), ("step", True), ("expected", 3)]
)
def test_values_of_another_type_are_refused(name: str, value: object) -> None:
    belief = a_filter("particles", True)
    arrays, header = belief.snapshot()
    with pytest.raises(ValueError, match=name):
        belief.restore(arrays, {**header, name: value})


def test_a_shared_error_whose_covariance_is_none_is_refused() -> None:
    belief = a_filter("particles", True)
    step(belief, "drives", "here", False)
    arrays, header = belief.snapshot()
    bad = arrays["shared"].copy()
    bad[3] = -1.0
    with pytest.raises(ValueError, match="positive definite"):
        belief.restore({**arrays, "shared": bad}, header)

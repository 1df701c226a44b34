"""On which of several maps: Bayes' rule over maps, what an image says of them, and the ways between them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.floors import FloorBelief, Transition, how_well_each_fits
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation import Places, VoteField

NAMES = ("ground", "first", "second")
likelihood = st.one_of(st.just(math.nan), st.floats(0.0, 1.0))


def field(best: float, confidence: float = 0.95, agreement: float | None = None, problem: str = "") -> VoteField:
    """Votes of one map: one cell stands out."""
    votes = np.full((36, 4), 0.1 * best, dtype=np.float32)
    votes[3, 1] = best
    places = Places(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]))
    found = VoteField(votes, 2.0 * np.pi * np.arange(36) / 36, places, 0.05, confidence=confidence, problem=problem)
    if agreement is None:
        return found
    seen = Agreement(agreement, np.full(24, agreement), agreement)
    return replace(found, measurement=PoseMeasurement(np.zeros(3), np.eye(3) * 1e-4, np.zeros(2), seen))


@given(st.lists(st.lists(likelihood, min_size=3, max_size=3), max_size=20), st.floats(0.0, 1.0))
@settings(max_examples=200, deadline=None)
def test_probabilities_stay_probabilities(images: list[list[float]], new: float) -> None:
    belief = FloorBelief(NAMES)
    for image in images:
        belief.predict({0: 1})
        belief.update(np.array(image), new)
        assert belief.probabilities.min() > 0.0
        assert belief.probabilities.sum() == pytest.approx(1.0)


@given(st.permutations(range(3)), st.lists(st.floats(0.01, 1.0), min_size=3, max_size=3))
def test_the_order_of_maps_does_not_matter(order: list[int], image: list[float]) -> None:
    straight, mixed = FloorBelief(NAMES), FloorBelief([NAMES[index] for index in order])
    straight.predict({})
    mixed.predict({})
    straight.update(np.array(image), 1.0)
    mixed.update(np.array(image)[order], 1.0)
    np.testing.assert_allclose(mixed.probabilities, straight.probabilities[order], rtol=1e-12)


def test_bayes_rule_by_hand() -> None:
    belief = FloorBelief(NAMES, np.array([0.5, 0.3, 0.2]))
    belief.update(np.array([0.2, 1.0, math.nan]), 1.0)
    # A map that was not asked keeps its share; the others divide what they had.
    np.testing.assert_allclose(belief.probabilities, [0.8 * 0.1 / 0.4, 0.8 * 0.3 / 0.4, 0.2])
    belief.update(np.array([0.2, 1.0, 0.1]), 0.0)
    np.testing.assert_allclose(belief.probabilities, [0.2, 0.6, 0.2])


def test_a_way_carries_half_of_what_is_believed() -> None:
    belief = FloorBelief(NAMES, np.array([1.0, 0.0, 0.0]))
    belief.predict({0: 2})
    assert belief.probabilities[2] == pytest.approx(0.5, abs=0.01)
    alone = FloorBelief(("only",))
    alone.predict({})
    assert alone.probabilities.tolist() == [1.0]


def test_who_was_carried_off_may_be_on_any_map() -> None:
    belief = FloorBelief(NAMES, np.array([1.0, 0.0, 0.0]))
    belief.predict({}, carried=1.0)
    np.testing.assert_allclose(belief.probabilities, 1.0 / 3.0)


def test_the_map_with_more_votes_fits_better_and_one_that_fits_nowhere_least() -> None:
    fits = how_well_each_fits([field(0.8), field(0.72), field(0.8, problem="image fits nowhere"), None])
    assert fits[0] == 1.0
    # 1.6 tolerances less, and the image may be wrong about itself.
    assert fits[1] == pytest.approx(0.95 * math.exp(-0.5 * 1.6**2) + 0.05, rel=1e-3)
    assert fits[2] == pytest.approx(0.05)
    assert math.isnan(fits[3])


def test_synthesis_decides_where_votes_are_even() -> None:
    fits = how_well_each_fits([field(0.8, agreement=0.6), field(0.8, agreement=0.9)])
    assert fits[1] == 1.0
    assert fits[0] < 0.1


def test_an_image_that_no_map_can_use_says_nothing() -> None:
    fits = how_well_each_fits([field(0.8, problem="image is black"), None, field(0.1, problem="image is black")])
    assert fits[0] == fits[2] == 1.0


def test_ways_lead_there_and_back() -> None:
    lift = Transition(("ground", "first"), ((1.0, 2.0), (5.0, 6.0)), radius_m=1.0)
    assert lift.leads_to("ground", np.array([1.5, 2.5, 0.0])) == "first"
    assert lift.leads_to("first", np.array([5.0, 6.9, 3.0])) == "ground"
    assert lift.leads_to("first", np.array([1.0, 2.0, 0.0])) is None
    assert lift.leads_to("second", np.array([1.0, 2.0, 0.0])) is None

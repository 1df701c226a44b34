"""A field of some of the places answers as the field of all of them does."""

import numpy as np
import pytest
from oracles.scenes import grid

from panoloc_mcl.robot.observation import Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.observation.large_maps.asked import Asked, evenly

PLACES = Places(grid(40, 30))
COUNT, HEADINGS = len(PLACES), 24
CIRCLE = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS


def votes_with_hills() -> np.ndarray:
    """Low votes all over, and two hills, one lower than the other."""
    votes = np.random.default_rng(0).uniform(0.05, 0.1, (HEADINGS, COUNT))
    for x, y, row, height in ((10.0, 12.0, 5, 0.8), (30.0, 20.0, 17, 0.6)):
        away = np.hypot(*(PLACES.positions - [x, y]).T)
        turned = np.abs((np.arange(HEADINGS) - row + 12) % HEADINGS - 12)
        votes += height * np.exp(-0.5 * (away / 1.5) ** 2) * np.exp(-0.5 * (turned / 1.2) ** 2)[:, None]
    return votes.astype(np.float32)


@pytest.fixture(scope="module")
def fields() -> tuple[VoteField, VoteField]:
    """Of all places, and of those with the most votes and a few more."""
    votes = votes_with_hills()
    likely = np.sort(np.argsort(-votes.max(axis=0))[:150])
    asked = Asked.among(likely, evenly(100, COUNT), COUNT)
    return VoteField(votes, CIRCLE, PLACES, 0.1), VoteField(votes[:, asked.places], CIRCLE, PLACES, 0.1, asked=asked)


def test_columns_and_places_are_inverse_and_stand_for_all() -> None:
    likely = np.array([3, 9, 700])
    asked = Asked.among(likely, np.array([0, 9, 500, 1100]), COUNT)
    assert asked.places.tolist() == [3, 9, 700, 0, 500, 1100]
    assert asked.columns[asked.places].tolist() == list(range(6))
    assert np.count_nonzero(asked.columns == 6) == COUNT - 6
    assert asked.stands_for[:3].tolist() == [1.0, 1.0, 1.0]
    assert asked.stands_for.sum() == pytest.approx(COUNT)


def test_the_best_cells_are_those_of_the_whole_field(fields: tuple[VoteField, VoteField]) -> None:
    whole, some = fields
    assert some.peak == whole.peak
    assert some.peak.margin < 0.5
    assert some.best_pose == pytest.approx(whole.best_pose)
    assert list(some.best_cells(2)) == list(whole.best_cells(2))
    weaker, weaker_whole = (field.weakened(5, whole.peak.place, 0.3) for field in (some, whole))
    assert weaker.peak == weaker_whole.peak


def test_what_is_known_of_the_whole_is_known_to_a_few_percent(fields: tuple[VoteField, VoteField]) -> None:
    whole, some = fields
    assert some.standing_out == pytest.approx(whole.standing_out, rel=0.05)
    for sharpness in (1.0, 0.2):
        assert some.mean_likelihood(sharpness) == pytest.approx(whole.mean_likelihood(sharpness), rel=0.05)
    assert some.guess is not None
    assert whole.guess is not None
    assert some.guess.probability == pytest.approx(whole.guess.probability, rel=0.05)


@pytest.mark.slow
def test_particles_read_the_same_votes_where_they_matter(fields: tuple[VoteField, VoteField]) -> None:
    whole, some = fields
    poses = np.random.default_rng(1).uniform([0.0, 0.0, -np.pi], [39.0, 29.0, np.pi], (5000, 3))
    found, expected = some.read(poses), whole.read(poses)
    # Elsewhere they read what others get on the mean, which varies by 0.015.
    assert np.abs(found - expected).max() < 0.06
    high = expected > 0.3
    assert np.count_nonzero(high) > 10
    assert np.abs(found - expected)[high].max() < 1e-6
    for pose in poses[np.flatnonzero(high)[:10]]:
        assert some.votes_at(pose) == pytest.approx(whole.votes_at(pose), abs=1e-6)
    assert np.abs(some.best_of_places - whole.best_of_places).max() < 0.06


def test_a_sample_is_drawn_where_that_of_the_whole_is(fields: tuple[VoteField, VoteField]) -> None:
    drawn = [field.sample(4000, np.random.default_rng(2)) for field in fields]
    assert drawn[0] == pytest.approx(drawn[1])


def test_where_all_may_be_right_the_field_is_the_whole() -> None:
    votes = votes_with_hills()
    asked = Asked.among(np.arange(COUNT), evenly(100, COUNT), COUNT)
    whole, some = VoteField(votes, CIRCLE, PLACES, 0.1), VoteField(votes[:, asked.places], CIRCLE, PLACES, 0.1, asked=asked)
    assert some.standing_out == pytest.approx(whole.standing_out)
    assert np.array_equal(some.best_of_places, whole.best_of_places)


def test_a_silent_field_of_a_large_map_is_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("panoloc_mcl.robot.observation.field.MOST_DENSE", 1000)
    field = silent_field(CIRCLE, PLACES, "image is black", full_circle=True)
    assert field.votes.shape[1] < 300
    assert not field.votes.any()
    assert not field.read(np.zeros((3, 3))).any()
    assert field.guess is None
    assert field.best_of_places.shape == (COUNT,)

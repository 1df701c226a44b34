import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import grid

from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.observation import Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field

HEADINGS = 72
CIRCLE = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
PLACES = Places(grid(4, 3))


def a_field(votes: np.ndarray, tolerance: float = 0.1, **more) -> VoteField:
    return VoteField(np.asarray(votes, dtype=np.float32), CIRCLE, PLACES, tolerance, **more)


def flat(level: float = 0.0) -> np.ndarray:
    return np.full((HEADINGS, len(PLACES)), level, dtype=np.float32)


def test_at_a_place_and_heading_the_cell_is_read() -> None:
    votes = np.random.default_rng(0).random((HEADINGS, len(PLACES)))
    rows, places = (index.ravel() for index in np.indices(votes.shape))
    poses = np.column_stack([PLACES.positions[places], CIRCLE[rows]])
    read = a_field(votes).read(poses)
    # The places of a grid lie in the middle of the raster's cells.
    assert np.abs(read - votes.ravel()).max() < 1e-3


def test_between_headings_it_reads_linearly() -> None:
    votes = flat()
    votes[5] = 1.0
    poses = np.column_stack([np.tile(PLACES.positions[0], (3, 1)), np.radians([25.0, 27.5, 28.75])])
    assert a_field(votes).read(poses) == pytest.approx([1.0, 0.5, 0.25], abs=1e-5)


def test_off_the_map_it_reads_zero() -> None:
    assert a_field(flat(1.0)).read(np.array([[-1.5, 0.0, 0.0], [50.0, 0.0, 1.0]])).tolist() == [0.0, 0.0]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, HEADINGS - 1), st.integers(0, 11), st.floats(-0.5, 0.5))
def test_the_peak_lies_at_the_top_of_the_parabola(row: int, place: int, offset: float) -> None:
    votes = flat()
    steps = np.round(np.degrees(angle_difference(CIRCLE, CIRCLE[row])) / (360.0 / HEADINGS))
    votes[:, place] = np.maximum(0.9 - 0.01 * (steps - offset) ** 2, 0.0)
    peak = a_field(votes).peak
    assert peak.place == place
    assert peak.votes == votes.max()
    expected = CIRCLE[row] + offset * 2.0 * np.pi / HEADINGS
    # float32 votes: differences of 0.01 hold about five digits.
    assert abs(float(angle_difference(peak.heading, expected))) < 1e-4


def test_a_plateau_has_its_peak_on_it() -> None:
    votes = flat()
    votes[[70, 71, 0, 1], 3] = 0.5
    peak = a_field(votes).peak
    assert abs(float(angle_difference(peak.heading, 0.0))) <= np.radians(12.5)
    assert np.isfinite(a_field(flat(0.3)).peak.heading)


@pytest.mark.parametrize("where", ["place", "heading"])
def test_the_margin_is_the_lead_over_a_rival_elsewhere(where: str) -> None:
    votes = flat()
    votes[10, 0] = 0.8
    votes[11, 0] = votes[10, 1] = 0.75  # near: no rival
    rival = (10, 11) if where == "place" else (50, 0)
    assert a_field(votes).peak.margin == pytest.approx(1.0)
    votes[rival] = 0.6
    assert a_field(votes).peak.margin == pytest.approx(0.25)
    votes[rival] = 0.8
    assert a_field(votes).peak.margin == pytest.approx(0.0)


def test_a_single_place_still_has_a_peak_and_a_margin() -> None:
    votes = np.zeros((HEADINGS, 1), dtype=np.float32)
    votes[3] = 0.5
    votes[40] = 0.25
    field = VoteField(votes, CIRCLE, Places(np.zeros((1, 2))), 0.1)
    assert field.peak.place == 0
    assert field.peak.margin == pytest.approx(0.5)
    assert field.read(np.array([[0.2, 0.0, CIRCLE[3]]])) == pytest.approx(0.5)


def test_headings_that_were_asked_for_are_not_interpolated() -> None:
    votes = np.array([[0.1, 0.2], [0.9, 0.3], [0.8, 0.1]], dtype=np.float32)
    headings = np.array([0.5, -1.0, 3.0])
    field = VoteField(votes, headings, Places(grid(2, 1)), 0.1, full_circle=False)
    assert field.peak.heading == headings[1]


def test_the_likelihood_is_one_at_the_peak_and_falls_as_a_gaussian() -> None:
    field = a_field(np.random.default_rng(1).random((HEADINGS, len(PLACES))), tolerance=0.2)
    assert field.likelihood(field.votes.ravel()).max() == 1.0
    best = field.peak.votes
    some = np.array([best, best - 0.2, best - 0.4, best + 0.1], dtype=np.float32)
    assert field.likelihood(some) == pytest.approx([1.0, np.exp(-0.5), np.exp(-2.0), 1.0], rel=1e-5)
    blunt = field.likelihood(some, sharpness=0.5, floor=0.1)
    assert blunt == pytest.approx(0.1 + 0.9 * np.exp([0.0, -0.25, -1.0, 0.0]), rel=1e-5)


def test_a_sample_stays_at_the_likely_cells() -> None:
    votes = flat()
    votes[20, 5] = votes[60, 0] = 0.9
    field = a_field(votes, tolerance=0.05)
    sample = field.sample(4000, np.random.default_rng(2))
    at_one = _near(sample, PLACES.positions[5], CIRCLE[20])
    at_other = _near(sample, PLACES.positions[0], CIRCLE[60])
    assert np.all(at_one | at_other)
    # A fair coin: six standard deviations.
    assert abs(at_one.mean() - 0.5) < 6.0 * 0.5 / np.sqrt(4000)
    assert np.all((sample[:, 2] >= -np.pi) & (sample[:, 2] < np.pi))


def _near(poses: np.ndarray, position: np.ndarray, heading: float) -> np.ndarray:
    # Five standard deviations of the spread over a cell.
    close = np.abs(poses[:, :2] - position).max(axis=1) < 5.0 * 0.35
    return close & (np.abs(angle_difference(poses[:, 2], heading)) < 5.0 * np.radians(5.0))


def test_a_sample_is_drawn_in_proportion_to_the_likelihood() -> None:
    votes = flat()
    votes[20, 0], votes[60, 11] = 0.9, 0.8
    field = a_field(votes, tolerance=0.1)
    sample = field.sample(8000, np.random.default_rng(3))
    share = _near(sample, PLACES.positions[11], CIRCLE[60]).mean()
    likelihood = np.exp(-0.5)
    expected = likelihood / (1.0 + likelihood)
    assert abs(share - expected) < 6.0 * 0.5 / np.sqrt(8000)


def test_a_silent_field_says_why_and_nothing_else() -> None:
    field = silent_field(CIRCLE, PLACES, "image is black", full_circle=True)
    assert not field.informative
    assert not field.votes.any()
    assert not field.read(np.zeros((3, 3))).any()
    assert (field.likelihood(field.votes.ravel()) == 1.0).all()
    assert field.peak.votes == field.peak.margin == 0.0
    assert np.isfinite(field.sample(5, np.random.default_rng(0))).all()


def test_one_pose_is_read_as_many_are_but_for_the_raster() -> None:
    rng = np.random.default_rng(3)
    field = a_field(rng.random((HEADINGS, len(PLACES))))
    for pose in rng.uniform([0.0, 0.0, -np.pi], [3.0, 2.0, np.pi], (50, 3)):
        # The raster's cells are a twentieth of the spacing.
        assert field.votes_at(pose) == pytest.approx(float(field.read(pose[None])[0]), abs=0.06)


def test_the_best_cells_are_apart_and_by_falling_votes() -> None:
    votes = flat(0.01)
    votes[10, 0], votes[11, 0], votes[40, 0], votes[10, 11] = 0.9, 0.89, 0.7, 0.8
    assert list(a_field(votes).best_cells(3)) == [(10, 0), (10, 11), (40, 0)]


def test_there_are_no_more_best_cells_than_cells_with_votes() -> None:
    votes = flat()
    votes[3, 2] = 0.4
    assert list(a_field(votes).best_cells(5)) == [(3, 2)]
    assert list(a_field(flat()).best_cells(5)) == []


def test_a_weakened_cell_gives_way_to_its_rival() -> None:
    votes = flat(0.01)
    votes[10, 0], votes[11, 0], votes[40, 11] = 0.9, 0.8, 0.85
    before = a_field(votes)
    after = before.weakened(10, 0, 0.5)
    assert (before.peak.place, after.peak.place) == (0, 11)
    assert after.votes[11, 0] == pytest.approx(0.4)
    assert after.votes[40, 0] == pytest.approx(0.01)
    assert before.votes[10, 0] == pytest.approx(0.9)


def test_noise_stands_out_less_than_a_match() -> None:
    votes = np.random.default_rng(0).random((HEADINGS, len(PLACES)))
    noise = a_field(votes).standing_out
    votes[4, 4] = 5.0
    assert a_field(votes).standing_out > 3.0 * noise
    assert a_field(flat(0.3)).standing_out == 0.0


def test_the_guess_is_the_best_cell_and_its_share_of_the_likelihood() -> None:
    votes = flat(0.01)
    votes[10, 5] = 0.9
    guess = a_field(votes, tolerance=0.1).guess
    assert guess is not None
    assert guess.pose == pytest.approx([*PLACES.positions[5], CIRCLE[10]], abs=1e-6)
    assert guess.probability > 0.9
    votes[40, 9] = 0.9
    divided = a_field(votes, tolerance=0.1).guess
    assert divided is not None
    assert 0.4 < divided.probability < 0.6
    judged = a_field(votes).judged(0.3, "image fits nowhere").guess
    assert judged is not None
    assert judged.probability == 0.3
    assert silent_field(CIRCLE, PLACES, "image is black", True).guess is None


def test_the_best_elsewhere_is_far_from_all_headings_that_were_asked() -> None:
    around = np.linspace(0.1, 0.8, HEADINGS).astype(np.float32)
    asked = np.radians([-10.0, 50.0])
    field = VoteField(flat(0.2)[:2], asked, PLACES, 0.1, full_circle=False, at_every_heading=around)
    assert field.best_at_any_heading == pytest.approx(0.8)
    # Beyond 20 degrees of -10: the last of those every 5 degrees is 325.
    assert field.best_elsewhere == around[65]
    everywhere = VoteField(flat(), CIRCLE, PLACES, 0.1, full_circle=False, at_every_heading=around)
    assert everywhere.best_elsewhere == 0.0
    assert np.isnan(a_field(flat(0.2)).best_elsewhere)
    assert np.isnan(a_field(flat(0.2)).best_at_any_heading)

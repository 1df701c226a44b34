import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import votes as brute
from oracles.scenes import COLUMNS, ROWS, grid, panorama, random_world, references, texture, turned

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.settings.observation import VotesSettings

# All frequencies, so that votes can be held against brute force; what the finest ones tell is tested below.
SETTINGS = VotesSettings(bandwidth=1.0)
WORLD = random_world(6)
MODEL = VotesModel.build(WORLD, SETTINGS)
FULL_TURN = 2.0 * np.pi
# Columns of a block of the norms: turns by whole blocks are exact, others exact as far as masks allow.
BLOCK = 5


def expected_votes(image: np.ndarray, chosen: VotesSettings, world=WORLD) -> np.ndarray:
    z, usable = orientations(panorama(image), chosen)
    of_places = [orientations(world.panorama(index), chosen) for index in range(len(world))]
    cosines = brute.masked_cosines(z, usable, [z for z, _ in of_places], [usable for _, usable in of_places])
    return brute.voted(cosines, chosen.vote_width)


@pytest.mark.parametrize("gradient", ["doubled_angle", "signed", "linear"])
def test_votes_agree_with_brute_force(gradient: str) -> None:
    chosen = VotesSettings(gradient=gradient, bandwidth=1.0)
    model = VotesModel.build(WORLD, chosen)
    for seed, columns in ((0, 0), (3, 17), (50, 0)):
        image = turned(texture(seed), columns)
        assert model.observe(panorama(image)).votes == pytest.approx(expected_votes(image, chosen), abs=2e-3)


def test_votes_agree_with_brute_force_under_a_bar() -> None:
    image = turned(texture(2), 20)
    image[:, 10:30] = 0
    votes = MODEL.observe(panorama(image)).votes
    every = slice(None, None, BLOCK)
    # The mask reaches two pixels beyond the bar, blocks know only its share: 3 of 5 columns.
    assert votes[every] == pytest.approx(expected_votes(image, SETTINGS)[every], abs=0.03)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 500), st.integers(-COLUMNS, 2 * COLUMNS))
def test_turning_the_image_shifts_the_field(seed: int, columns: int) -> None:
    image = texture(seed)
    votes = MODEL.observe(panorama(image)).votes
    after = MODEL.observe(panorama(turned(image, columns))).votes
    assert after == pytest.approx(np.roll(votes, columns, axis=0), abs=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 500), st.integers(-30, 30), st.integers(0, 30))
def test_turning_a_masked_image_by_whole_blocks_shifts_the_field(seed: int, blocks: int, start: int) -> None:
    image = texture(seed)
    image[:, start : start + 25] = 255
    votes = MODEL.observe(panorama(image)).votes
    after = MODEL.observe(panorama(turned(image, blocks * BLOCK))).votes
    assert after == pytest.approx(np.roll(votes, blocks * BLOCK, axis=0), abs=1e-4)
    # Between blocks the norms are interpolated.
    between = MODEL.observe(panorama(turned(image, 2))).votes
    assert between == pytest.approx(np.roll(votes, 2, axis=0), abs=0.05)


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("columns", [0, 7, 30, 59])
def test_a_reference_finds_itself_at_its_heading(place: int, columns: int) -> None:
    field = MODEL.observe(panorama(turned(texture(place), columns)))
    assert field.informative
    assert field.votes.dtype == np.float32
    assert field.peak.place == place
    assert field.peak.votes == pytest.approx(1.0, abs=1e-3)
    # The camera turned left by so many columns of 6 degrees.
    assert np.cos(field.peak.heading - columns * FULL_TURN / COLUMNS) > np.cos(np.radians(0.5))
    assert field.peak.margin > 0.3


@pytest.mark.parametrize("change", [lambda i: 0.4 * i, lambda i: 0.8 * i + 30.0, lambda i: 255.0 - i])
def test_light_changes_little(change) -> None:
    field = MODEL.observe(panorama(change(turned(texture(4), 11).astype(np.float32))))
    assert field.peak.place == 4
    assert np.cos(field.peak.heading - 11 * FULL_TURN / COLUMNS) > np.cos(np.radians(1.0))
    assert field.peak.votes > 0.8


@pytest.mark.parametrize("sd", [0.0, 4.0, 80.0, 120.0])
def test_a_field_says_whether_its_image_is_noise_for_the_most_part(sd: float) -> None:
    image = turned(texture(4), 11) + np.random.default_rng(0).normal(0.0, sd, (ROWS, COLUMNS))
    field = MODEL.observe(panorama(image.astype(np.float32)))
    assert field.noisy == (sd > 10.0)
    assert field.judged(0.9, "").noisy == field.noisy


@pytest.mark.parametrize(
    ("image", "words"),
    [(np.zeros((ROWS, COLUMNS)), "black"), (np.full((ROWS, COLUMNS), 255), "saturated"),
     (np.full((ROWS, COLUMNS), 90), "no texture"), (np.where(np.arange(COLUMNS) < 30, 0, 255) + np.zeros((ROWS, 1)), "")],
)  # fmt: skip
@pytest.mark.parametrize("headings", [None, np.array([0.1, 2.0])])
def test_images_without_information_say_so(image: np.ndarray, words: str, headings) -> None:
    field = MODEL.observe(panorama(image), headings)
    assert not field.informative
    assert words in field.problem
    assert "\n" not in field.problem
    assert not field.votes.any()
    assert field.votes.shape == ((COLUMNS if headings is None else 2), 6)
    assert np.isfinite(field.tolerance)


def test_an_image_that_is_mostly_unseen_says_so() -> None:
    valid = np.zeros((ROWS, COLUMNS), dtype=bool)
    valid[8:11, 3:8] = True
    field = MODEL.observe(panorama(texture(0), valid))
    assert "masked" in field.problem


@pytest.mark.parametrize("seed", range(5))
def test_votes_are_numbers_between_zero_and_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = texture(seed)
    image[:, rng.random(COLUMNS) < 0.6] = 0
    votes = MODEL.observe(panorama(image)).votes
    assert np.isfinite(votes).all()
    assert votes.min() >= 0.0
    assert votes.max() <= 1.0


def test_asked_headings_are_read_from_the_circle() -> None:
    picture = panorama(turned(texture(1), 13))
    everything = MODEL.observe(picture)
    whole = np.array([0, 13, 59, 60, -1])
    some = MODEL.observe(picture, whole * FULL_TURN / COLUMNS)
    assert not some.full_circle
    assert some.votes == pytest.approx(everything.votes[whole % COLUMNS], abs=1e-6)
    assert some.tolerance == everything.tolerance
    np.testing.assert_array_equal(some.at_every_heading, everything.votes.max(axis=1))
    assert some.best_at_any_heading == everything.peak.votes
    between = MODEL.observe(picture, np.array([13.25]) * FULL_TURN / COLUMNS)
    assert between.votes[0] == pytest.approx(0.75 * everything.votes[13] + 0.25 * everything.votes[14], abs=1e-5)


def test_what_is_restored_votes_the_same_to_the_last_bit() -> None:
    restored = VotesModel.restore(WORLD, SETTINGS, MODEL.arrays())
    picture = panorama(turned(texture(5), 21))
    assert np.array_equal(restored.observe(picture).votes, MODEL.observe(picture).votes)
    assert restored.kept == MODEL.kept
    again = VotesModel.build(WORLD, SETTINGS, seed=99)
    assert np.array_equal(again.observe(picture).votes, MODEL.observe(picture).votes)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_references_suffice(count: int) -> None:
    model = VotesModel.build(random_world(count), SETTINGS)
    for place in range(count):
        peak = model.observe(panorama(turned(texture(place), 8))).peak
        assert peak.place == place
        assert np.cos(peak.heading - 8 * FULL_TURN / COLUMNS) > np.cos(np.radians(1.0))


def test_fewer_components_still_find_the_place_and_keep_less() -> None:
    coarse = VotesModel.build(WORLD, VotesSettings(components=4, bandwidth=1.0))
    assert coarse.kept < MODEL.kept <= 1.0
    assert MODEL.kept == pytest.approx(1.0)
    field = coarse.observe(panorama(turned(texture(0), 8)))
    assert 0.0 < field.votes.max() <= MODEL.observe(panorama(turned(texture(0), 8))).votes.max() + 1e-3


def test_equal_references_share_the_votes() -> None:
    world = references([texture(0), texture(0), texture(1)], [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
    votes = VotesModel.build(world, SETTINGS).observe(panorama(texture(0))).votes
    assert votes[:, 0] == pytest.approx(votes[:, 1], abs=1e-4)


def test_references_without_texture_are_named_one_line_each() -> None:
    black = np.zeros((ROWS, COLUMNS), dtype=np.uint8)
    world = references([texture(0), black, black + 100], [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
    with pytest.raises(MapError) as caught:
        VotesModel.build(world, SETTINGS)
    assert [fault.split(":")[0] for fault in caught.value.faults] == ["reference ref_1.png", "reference ref_2.png"]


@pytest.mark.parametrize(
    ("rows", "width", "line"),
    [
        (20, 3.5, r"smoothing_px = 3\.5: .* 25 x 25 .* 20 rows .* at most 2\.66$"),
        (2, 0.0, r"3 x 3 .* 2 rows .*; use larger panoramas$"),
    ],
)
def test_filters_larger_than_the_image_are_refused_in_one_line(rows: int, width: float, line: str) -> None:
    world = references([texture(seed, rows, COLUMNS) for seed in range(3)], grid(3, 1))
    with pytest.raises(MapError, match=rf"observation\.votes\..*{line}") as caught:
        VotesModel.build(world, VotesSettings(smoothing_px=width))
    assert len(caught.value.faults) == 1


def test_more_components_than_references_are_refused() -> None:
    with pytest.raises(MapError, match=r"observation\.votes\.components = 9"):
        VotesModel.build(WORLD, VotesSettings(components=9))


def test_what_the_reference_camera_does_not_see_does_not_count() -> None:
    valid = np.ones((ROWS, COLUMNS), dtype=bool)
    valid[12:] = False
    images = [np.where(valid, texture(seed), 0).astype(np.uint8) for seed in range(3)]
    model = VotesModel.build(references(images, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], valid), SETTINGS)
    # The query sees all rows, the lower ones of another world: the map has nothing to compare them with.
    query = np.where(valid, texture(1), texture(77))
    field = model.observe(panorama(turned(query, 10)))
    assert field.peak.place == 1
    assert field.peak.votes > 0.8


def test_sizes_that_no_block_divides() -> None:
    world = references([texture(seed, 13, 37) for seed in range(3)], [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
    model = VotesModel.build(world, SETTINGS)
    for columns in (0, 1, 36):
        peak = model.observe(panorama(turned(texture(2, 13, 37), columns))).peak
        assert peak.place == 2
        assert np.cos(peak.heading - columns * FULL_TURN / 37) > np.cos(np.radians(1.0))


@pytest.mark.parametrize("place", range(6))
def test_a_narrow_band_finds_the_same_place_and_heading(place: int) -> None:
    narrow = VotesModel.build(WORLD, VotesSettings(bandwidth=0.4))
    peak = narrow.observe(panorama(turned(WORLD.pixels[place], 17))).peak
    assert peak.place == place
    assert peak.heading == pytest.approx(
        17 * FULL_TURN / COLUMNS - FULL_TURN * (COLUMNS < 17 * 2), abs=0.5 * FULL_TURN / COLUMNS
    )

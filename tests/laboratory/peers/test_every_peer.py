"""What holds for every cited peer."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import COLUMNS, ROWS, grid, panorama, random_world, references, texture, turned

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.observation import model_named
from panoloc_mcl.robot.settings.config import ObservationSettings

WORLD = random_world(6)
SMALL = {"components": 5}
CHOSEN = {
    "fourier_signature": {},
    "eigenspace": SMALL,
    "least_squares": SMALL,
    "spinning": {"components": 60},
    "zero_phase": SMALL,
    "orientation_correlation": {},
    "nearest_reference": {},
    "template_matching": {},
}
PEERS = tuple(CHOSEN)
STEP = 2.0 * np.pi / COLUMNS


def build(name: str, world=WORLD, **changes):
    observation = ObservationSettings.model_validate({"model": name, name: {**CHOSEN[name], **changes}})
    return model_named(name).build(world, observation.selected, 0)


BUILT = {name: build(name) for name in PEERS}


@pytest.fixture(params=PEERS)
def name(request) -> str:
    return request.param


def test_a_turned_reference_is_recognised_with_its_heading(name: str) -> None:
    for place, columns in ((0, 0), (3, 17), (5, 59)):
        field = BUILT[name].observe(panorama(turned(texture(place), columns)))
        assert field.informative
        assert field.peak.place == place
        # The heading is read between the columns, where a peak need not be symmetric.
        assert np.cos(field.peak.heading - columns * STEP) > np.cos(0.5 * STEP)
        assert field.votes.min() >= 0.0
        assert field.votes.max() <= 1.0 + 1e-6


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(PEERS), st.integers(0, 500), st.integers(-COLUMNS, 2 * COLUMNS))
def test_turning_the_image_shifts_the_field(name: str, seed: int, columns: int) -> None:
    image = texture(seed)
    votes = BUILT[name].observe(panorama(image)).votes
    after = BUILT[name].observe(panorama(turned(image, columns))).votes
    assert after == pytest.approx(np.roll(votes, columns, axis=0), abs=2e-3)


def test_asked_headings_are_those_of_the_full_field(name: str) -> None:
    image = panorama(turned(texture(1), 8))
    full = BUILT[name].observe(image)
    asked = np.array([0.0, 8.0, 8.5, -1.0]) * STEP
    field = BUILT[name].observe(image, asked)
    assert not field.full_circle
    assert field.headings == pytest.approx(asked)
    expected = np.stack([full.votes[0], full.votes[8], 0.5 * (full.votes[8] + full.votes[9]), full.votes[-1]])
    assert field.votes == pytest.approx(expected, abs=1e-6)
    assert field.peak.heading == pytest.approx(asked[np.argmax(field.votes.max(axis=1))])


def test_a_restored_model_votes_exactly_as_before(name: str) -> None:
    image = panorama(turned(texture(70), 11))
    restored = model_named(name).restore(WORLD, BUILT[name].settings, BUILT[name].arrays())
    assert np.array_equal(restored.observe(image).votes, BUILT[name].observe(image).votes)
    assert all(np.array_equal(restored.arrays()[key], array) for key, array in BUILT[name].arrays().items())


def test_building_twice_gives_the_same_map(name: str) -> None:
    again = build(name).arrays()
    assert all(np.array_equal(again[key], array) for key, array in BUILT[name].arrays().items())


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.zeros((ROWS, COLUMNS), np.uint8), "black"),
        (np.random.default_rng(0).integers(0, 3, (ROWS, COLUMNS)).astype(np.uint8), "black"),
        (np.full((ROWS, COLUMNS), 255, np.uint8), "saturated"),
        (np.full((ROWS, COLUMNS), 128, np.uint8), "no texture"),
    ],
)
@pytest.mark.parametrize("headings", [None, np.array([0.1, 0.2])])
def test_images_that_say_nothing_get_a_silent_field(name: str, image, reason: str, headings) -> None:
    field = BUILT[name].observe(panorama(image), headings)
    assert not field.informative
    assert reason in field.problem
    assert not field.votes.any()
    assert field.votes.shape == (COLUMNS if headings is None else 2, len(WORLD))


@pytest.mark.parametrize(
    "image",
    [
        np.tile(np.linspace(40, 200, ROWS)[:, None], (1, COLUMNS)),
        np.tile(np.where(np.arange(COLUMNS) % 2, 50.0, 200.0), (ROWS, 1)),
        np.where(np.arange(COLUMNS) < 50, 0.0, texture(1)),
        texture(1) * 5.0 - 400.0,
        0.02 * texture(1) + 3.0,
        np.random.default_rng(1).integers(0, 256, (ROWS, COLUMNS)).astype(float),
    ],
    ids=["rows", "stripes", "bar", "contrast", "dim", "noise"],
)
def test_no_image_gives_anything_but_finite_votes(name: str, image) -> None:
    field = BUILT[name].observe(panorama(np.clip(image, 0.0, 255.0)))
    assert np.isfinite(field.votes).all()
    assert np.isfinite(field.tolerance)
    assert field.tolerance > 0.0
    assert field.votes.min() >= 0.0
    assert field.votes.max() <= 1.0 + 1e-6


def test_images_without_a_first_harmonic_have_no_zero_phase() -> None:
    stripes = np.tile(np.where(np.arange(COLUMNS) % 2, 50.0, 200.0), (ROWS, 1))
    assert "harmonic" in BUILT["zero_phase"].observe(panorama(stripes)).problem
    images = [texture(0), stripes.astype(np.uint8), texture(2)]
    with pytest.raises(MapError, match=r"ref_1\.png.*first harmonic"):
        build("zero_phase", references(images, grid(3, 1)), components=1)


def test_references_without_texture_are_named_all_at_once(name: str) -> None:
    images = [texture(0), np.full((ROWS, COLUMNS), 90, np.uint8), texture(2), np.zeros((ROWS, COLUMNS), np.uint8)]
    with pytest.raises(MapError) as caught:
        build(name, references(images, grid(2, 2)))
    assert len(caught.value.faults) == 2
    assert "ref_1.png" in caught.value.faults[0]
    assert "ref_3.png" in caught.value.faults[1]


@pytest.mark.parametrize("name", ["eigenspace", "least_squares", "spinning", "zero_phase"])
def test_more_components_than_the_references_span_are_refused(name: str) -> None:
    with pytest.raises(MapError, match=rf"observation\.{name}\.components = 5000: .*set at most \d+") as caught:
        build(name, components=5000)
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize("name", ["eigenspace", "least_squares", "spinning", "zero_phase"])
@pytest.mark.parametrize("count", [1, 3])
def test_references_that_do_not_differ_have_no_eigenspace(name: str, count: int) -> None:
    with pytest.raises(MapError, match=rf"observation\.model = {name}: .*do not differ; add references"):
        build(name, references([texture(0)] * count, grid(3, 1)[:count]), components=1)


def test_more_frequencies_than_columns_allow_are_refused() -> None:
    with pytest.raises(MapError, match=r"fourier_signature\.frequencies = 31: .*set at most 30"):
        build("fourier_signature", frequencies=31)


@pytest.mark.parametrize("name", ["fourier_signature", "orientation_correlation"])
def test_a_single_reference_is_enough_without_an_eigenspace(name: str) -> None:
    field = build(name, references([texture(0)], grid(1, 1))).observe(panorama(turned(texture(0), 9)))
    assert field.peak.place == 0
    assert np.cos(field.peak.heading - 9 * STEP) > np.cos(0.5 * STEP)


@pytest.mark.parametrize("columns", [59, 60])
def test_odd_and_even_widths(name: str, columns: int) -> None:
    images = [texture(seed, columns=columns) for seed in range(4)]
    model = build(name, references(images, grid(2, 2)), **({"components": 3} if "components" in CHOSEN[name] else {}))
    field = model.observe(panorama(turned(images[2], 20)))
    assert field.votes.shape == (columns, 4)
    assert field.peak.place == 2
    assert np.cos(field.peak.heading - 20 * 2.0 * np.pi / columns) > np.cos(0.5 * 2.0 * np.pi / columns)


def test_rows_that_the_references_do_not_show_do_not_count(name: str) -> None:
    valid = np.ones((ROWS, COLUMNS), dtype=bool)
    valid[:4] = False
    world = replace(WORLD, valid=np.broadcast_to(valid, WORLD.pixels.shape))
    image = turned(texture(3), 12)
    other = image.copy()
    other[:4] = texture(90)[:4]
    model = build(name, world)
    assert np.array_equal(model.observe(panorama(image)).votes, model.observe(panorama(other)).votes)


@pytest.mark.parametrize("gain", [0.5, 0.8])
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("eigenspace", {}),
        ("spinning", {}),
        ("zero_phase", {}),
        ("least_squares", {"mean_column": True}),
        ("orientation_correlation", {}),
    ],
)
def test_a_global_gain_changes_nothing_where_the_model_says_so(name: str, changes: dict, gain: float) -> None:
    model = build(name, **changes)
    image = turned(texture(4), 33).astype(float)
    darker = model.observe(panorama(gain * image)).votes
    assert darker == pytest.approx(model.observe(panorama(image)).votes, abs=3e-3)

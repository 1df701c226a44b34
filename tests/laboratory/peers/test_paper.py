import numpy as np
import pytest
from oracles import kernels as naive
from oracles.scenes import COLUMNS, ROWS, grid, panorama, random_world, references, texture, turned
from scipy import signal

from panoloc_mcl.laboratory.peers.linear_filters import DIRECTIONS_DEG, filter_bank, gaussian_derivative
from panoloc_mcl.laboratory.peers.paper import PaperModel
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.robot.errors import MapError

SETTINGS = PaperSettings(components=4, hypotheses=6, pixels=80, trim_keep=0.8, trim_to=40, heading_step_deg=6.0)
WORLD = random_world(6)
MODEL = PaperModel.build(WORLD, SETTINGS, seed=1)
FULL_TURN = 2.0 * np.pi


def bank(image: np.ndarray, filters: str, width: float) -> np.ndarray:
    """Responses of all three filters."""
    if filters == "gradients":
        return filter_bank(image.astype(np.float32))
    along = gaussian_derivative(width)
    reach = len(along) // 2
    padded = np.pad(
        np.pad(image.astype(np.float64), ((reach, reach), (0, 0)), mode="edge"), ((0, 0), (reach, reach)), mode="wrap"
    )
    x, y = (signal.correlate2d(padded, kernel, mode="valid") for kernel in (along, along.T))
    return np.stack([np.cos(a) * x + np.sin(a) * y for a in np.radians(DIRECTIONS_DEG)]).astype(np.float32)


@pytest.mark.parametrize(("filters", "width"), [("gradients", 1.0), ("steerable", 0.8), ("steerable", 2.0)])
def test_votes_agree_with_sections_2_and_3_done_by_hand(filters: str, width: float) -> None:
    """Eigenspace by SVD, all three filters, hypotheses by lstsq at every step, the image really turned back."""
    chosen = SETTINGS.model_copy(update={"filters": filters, "filter_width_px": width})
    model = PaperModel.build(WORLD, chosen, seed=1)
    images = WORLD.pixels.reshape(6, -1).astype(np.float64)
    mean = images.mean(axis=0)
    _, _, basis = np.linalg.svd(images - mean, full_matrices=False)
    basis = basis[: SETTINGS.components]
    coefficients = (images - mean) @ basis.T
    filtered = [bank(e.reshape(ROWS, COLUMNS), filters, width) for e in basis]
    filtered_mean = bank(mean.reshape(ROWS, COLUMNS), filters, width)
    kept = model.arrays()
    rows, columns = kept["rows"], kept["columns"]
    query = turned(texture(3), 10)
    votes = naive.vote(
        bank(query, filters, width),
        rows,
        columns,
        np.stack([f[:, rows, columns] for f in filtered], axis=-1).transpose(1, 2, 0, 3),
        filtered_mean[:, rows, columns].transpose(1, 2, 0),
        coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True),
        np.arange(0.0, COLUMNS, COLUMNS / 60),
        SETTINGS.trim_keep,
        SETTINGS.trim_to,
        SETTINGS.vote_width,
    )
    # Single precision may trim another pixel here and there, which moves a hypothesis a little.
    differences = np.abs(model.observe(panorama(query)).votes - votes)
    assert np.median(differences) < 1e-4
    assert np.mean(differences > 0.02) < 0.02


@pytest.mark.parametrize("place", range(6))
def test_a_reference_finds_itself_at_its_heading(place: int) -> None:
    field = MODEL.observe(panorama(turned(texture(place), 25)))
    assert field.peak.place == place
    assert np.cos(field.peak.heading - 25 * FULL_TURN / COLUMNS) > np.cos(np.radians(2.0))
    assert 0.0 < field.votes.max() <= 1.0


@pytest.mark.parametrize("columns", [1, 17, -8, 60])
def test_turning_the_image_shifts_the_field(columns: int) -> None:
    image = texture(40)
    votes = MODEL.observe(panorama(image)).votes
    after = MODEL.observe(panorama(turned(image, columns))).votes
    # Rounding of the responses differs a little with the column; a tie in trimming may then fall the other way.
    assert np.mean(np.abs(after - np.roll(votes, columns, axis=0)) > 1e-3) < 0.01


def test_asked_headings_give_the_votes_of_the_circle() -> None:
    picture = panorama(turned(texture(2), 5))
    everything = MODEL.observe(picture)
    whole = np.array([5, 0, -1, 61])
    some = MODEL.observe(picture, whole * FULL_TURN / COLUMNS)
    assert not some.full_circle
    assert some.votes == pytest.approx(everything.votes[whole % COLUMNS], abs=1e-6)


@pytest.mark.parametrize("level", [0, 90, 255])
def test_constant_images_say_nothing(level: int) -> None:
    field = MODEL.observe(panorama(np.full((ROWS, COLUMNS), level)))
    assert not field.informative
    assert not field.votes.any()


def test_what_is_restored_votes_the_same_to_the_last_bit() -> None:
    restored = PaperModel.restore(WORLD, SETTINGS, MODEL.arrays())
    picture = panorama(texture(33))
    assert np.array_equal(restored.observe(picture).votes, MODEL.observe(picture).votes)


def test_the_seed_decides_the_pixels() -> None:
    same, other = (PaperModel.build(WORLD, SETTINGS, seed).arrays() for seed in (1, 2))
    assert all(np.array_equal(same[key], MODEL.arrays()[key]) for key in same)
    assert not np.array_equal(other["columns"], same["columns"])
    flat = same["rows"].astype(int) * COLUMNS + same["columns"]
    assert all(len(np.unique(row)) == SETTINGS.pixels for row in flat)


def test_two_references_are_enough() -> None:
    model = PaperModel.build(random_world(2), SETTINGS.model_copy(update={"components": 1}))
    assert model.observe(panorama(texture(1))).peak.place == 1


@pytest.mark.parametrize(
    ("count", "changes", "key"),
    [
        (6, {"components": 6}, "components = 6"),
        (1, {"components": 1}, "components = 1"),
        (6, {"pixels": 5000}, "pixels = 5000"),
        (6, {"components": 5, "pixels": 2}, "pixels = 2"),
        (6, {"filters": "steerable", "filter_width_px": 5.0}, "filter_width_px = 5: .* 31 x 31 .* 20 rows .* at most 3$"),
    ],
)
def test_settings_that_ask_for_too_much_are_refused_in_one_line(count: int, changes: dict, key: str) -> None:
    with pytest.raises(MapError, match=rf"observation\.paper\.{key}") as caught:
        PaperModel.build(random_world(count), SETTINGS.model_copy(update=changes))
    assert len(caught.value.faults) == 1


def test_three_by_three_filters_are_refused_on_images_of_two_rows() -> None:
    world = references([texture(seed, 2, 60) for seed in range(6)], grid(3, 2))
    with pytest.raises(MapError, match=r"observation\.paper\.filters = gradients: .*3 x 3 .* 2 rows"):
        PaperModel.build(world, SETTINGS)


def test_the_widest_filters_that_fit_are_taken() -> None:
    widest = SETTINGS.model_copy(update={"filters": "steerable", "filter_width_px": 3.0})
    assert PaperModel.build(WORLD, widest).observe(panorama(texture(2))).informative

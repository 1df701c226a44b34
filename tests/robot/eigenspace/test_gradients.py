import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import orientations as naive
from oracles.scenes import COLUMNS, ROWS, panorama, texture

from panoloc_mcl.robot.eigenspace.gradients import noise_share, orientations, pad_circular, quiet
from panoloc_mcl.robot.settings.observation import VotesSettings

KINDS = ["doubled_angle", "signed", "linear"]
# Gradients come from float32 grey levels of up to 255: about 1e-5 grey levels, against a contrast floor of a few.
CLOSE = 1e-4


@pytest.mark.parametrize("gradient", KINDS)
@pytest.mark.parametrize("smoothing", [0.0, 0.8, 1.0, 2.5])
@pytest.mark.parametrize("median", [False, True])
def test_they_agree_with_numpy_and_scipy(gradient: str, smoothing: float, median: bool) -> None:
    chosen = VotesSettings(gradient=gradient, smoothing_px=smoothing, median=median)
    image = texture(1)
    image[5:9, 10:14] = 0
    image[12, 40] = 255
    image[14:16, 0] = 254
    valid = np.ones(image.shape, dtype=bool)
    valid[-3:, 20:30] = False
    z, usable = orientations(panorama(image, valid), chosen)
    expected, expected_usable = naive.orientations(image, valid, chosen)
    assert np.array_equal(usable, expected_usable)
    assert np.abs(z - expected).max() < CLOSE


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.integers(-200, 200), st.sampled_from(KINDS), st.booleans())
def test_turning_the_image_turns_the_features(seed: int, columns: int, gradient: str, masked: bool) -> None:
    chosen = VotesSettings(gradient=gradient)
    image = texture(seed)
    valid = np.random.default_rng(seed).random(image.shape) > 0.02 if masked else None
    z, usable = orientations(panorama(image, valid), chosen)
    turned_valid = None if valid is None else np.roll(valid, columns, axis=1)
    turned_z, turned_usable = orientations(panorama(np.roll(image, columns, axis=1), turned_valid), chosen)
    assert np.array_equal(turned_usable, np.roll(usable, columns, axis=1))
    assert np.abs(turned_z - np.roll(z, columns, axis=1)).max() < CLOSE


@pytest.mark.parametrize("gradient", KINDS)
@pytest.mark.parametrize("gain", [0.3, 0.6, 1.05])
def test_gain_and_offset_vanish_with_the_contrast_floor(gradient: str, gain: float) -> None:
    image = texture(2).astype(np.float32)
    changes = []
    for floor in (10.0, 1.0, 0.1, 0.01):
        chosen = VotesSettings(gradient=gradient, contrast_floor=floor)
        z, usable = orientations(panorama(image), chosen)
        lit, lit_usable = orientations(panorama(gain * image + 5.0 * (gain < 1.0)), chosen)
        changes.append(np.abs(z - lit)[usable & lit_usable].mean())
    assert changes == sorted(changes, reverse=True)
    assert changes[-1] < 0.02 * changes[0]


@pytest.mark.parametrize("gradient", ["doubled_angle", "signed"])
def test_features_never_exceed_one(gradient: str) -> None:
    z, _ = orientations(panorama(texture(3)), VotesSettings(gradient=gradient, contrast_floor=0.01))
    assert 0.9 < np.abs(z).max() <= 1.0 + 1e-6


def test_linear_gradients_are_gradients_of_unit_length_but_for_the_floor() -> None:
    image = texture(9).astype(np.float32)
    chosen = VotesSettings(gradient="linear", contrast_floor=0.001, smoothing_px=0.0, median=False)
    z, usable = orientations(panorama(image), chosen)
    assert np.mean(np.abs(z[usable]) ** 2) == pytest.approx(1.0, abs=1e-3)
    g = 0.5 * (np.roll(image, -1, axis=1) - np.roll(image, 1, axis=1))[usable]
    assert np.corrcoef(z.real[usable], g)[0, 1] == pytest.approx(1.0, abs=1e-6)
    # Light that varies over the room is left in, unlike with local normalisation.
    lit = image * np.linspace(0.3, 1.0, COLUMNS, dtype=np.float32)
    changes = {
        kind: np.abs(
            orientations(panorama(lit), VotesSettings(gradient=kind))[0]
            - orientations(panorama(image), VotesSettings(gradient=kind))[0]
        ).mean()
        / np.abs(orientations(panorama(image), VotesSettings(gradient=kind))[0]).mean()
        for kind in KINDS
    }
    assert changes["linear"] > 1.5 * changes["signed"]


def test_turned_contrast_keeps_doubled_angles_and_flips_signed_ones() -> None:
    image = texture(4).astype(np.float32)
    for gradient, sign in (("doubled_angle", 1.0), ("signed", -1.0), ("linear", -1.0)):
        chosen = VotesSettings(gradient=gradient)
        z, usable = orientations(panorama(image), chosen)
        negative, negative_usable = orientations(panorama(255.0 - image), chosen)
        assert np.array_equal(usable, negative_usable)
        assert np.abs(negative - sign * z).max() < CLOSE


def test_the_angle_is_that_of_the_gradient() -> None:
    ramp = np.tile(np.arange(ROWS, dtype=np.float32)[:, None] * 5.0 + 50.0, (1, COLUMNS))
    z, usable = orientations(panorama(ramp), VotesSettings(gradient="signed", contrast_floor=1.0, smoothing_px=0.0))
    # Brighter downwards by 5 grey levels a row: g = 5i, and 5i / (5 + 1).
    assert np.allclose(z[usable], 5j / 6.0, atol=1e-6)
    doubled, usable = orientations(panorama(ramp), VotesSettings(contrast_floor=1.0, smoothing_px=0.0))
    assert np.allclose(doubled[usable], -25.0 / 26.0, atol=1e-6)


@pytest.mark.parametrize("level", [0, 2, 253, 255])
def test_black_and_saturated_regions_are_masked(level: int) -> None:
    image = texture(5)
    image[6:14, 20:35] = level
    z, usable = orientations(panorama(image), VotesSettings())
    # Corners are what a median rounds off; the reach about the region is two pixels.
    assert not usable[6:14, 18:37].any()
    assert usable[2:18, np.r_[0:17, 38:60]].all()
    assert not z[~usable].any()
    everything, all_usable = orientations(panorama(image), VotesSettings(mask_dark=-1, mask_bright=256))
    assert all_usable[1:-1].all()
    assert everything[6:14, 18:37].any()


def test_a_mask_reaches_over_the_seam() -> None:
    valid = np.ones((ROWS, COLUMNS), dtype=bool)
    valid[10, 0] = False
    _, usable = orientations(panorama(texture(6), valid), VotesSettings())
    assert not usable[10, [-2, -1, 0, 1, 2]].any()
    assert usable[10, 3:-2].all()


def test_the_upper_and_lower_rim_are_never_used() -> None:
    _, usable = orientations(panorama(texture(7)), VotesSettings())
    assert not usable[[0, -1]].any()
    assert usable[1:-1].all()


def test_the_median_removes_isolated_pixels() -> None:
    # Over a slowly changing image the median changes little but the bad pixels.
    image = np.rint(128 + 60 * np.sin(np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False)) + np.zeros((ROWS, 1)))
    clean = image.astype(np.uint8)
    dirty = clean.copy()
    dirty[4::5, 3::6] = 255
    dirty[2::5, 5::6] = 0
    with_median = VotesSettings(median=True)
    without = VotesSettings(median=False)
    z, usable = orientations(panorama(clean), with_median)
    again, again_usable = orientations(panorama(dirty), with_median)
    assert np.array_equal(usable, again_usable)
    assert np.abs(again - z).mean() < 0.1 * np.abs(z).mean()
    assert orientations(panorama(dirty), without)[1].mean() < 0.5


@pytest.mark.parametrize("gradient", KINDS)
@pytest.mark.parametrize("level", [0, 7, 128, 255])
def test_constant_images_give_zeros_and_no_nan(gradient: str, level: int) -> None:
    z, usable = orientations(panorama(np.full((ROWS, COLUMNS), level)), VotesSettings(gradient=gradient))
    assert np.isfinite(z).all()
    assert np.abs(z).max() < CLOSE
    assert usable.any() == (2 < level < 253)


def test_padding_wraps_even_beyond_the_width() -> None:
    image = np.arange(8, dtype=np.float32).reshape(2, 4)
    padded = pad_circular(image, 10)
    assert np.array_equal(padded, image[:, np.arange(-10, 14) % 4])


def test_a_wide_gaussian_on_a_narrow_image_is_still_circular() -> None:
    image = texture(8, 16, 24)
    chosen = VotesSettings(smoothing_px=6.0)
    z, _ = orientations(panorama(image), chosen)
    shifted, _ = orientations(panorama(np.roll(image, 7, axis=1)), chosen)
    assert np.abs(shifted - np.roll(z, 7, axis=1)).max() < CLOSE
    assert cv2.norm(z.real) > 0.0


def clouds(seed: int, columns: int = 180, rows: int = 72) -> np.ndarray:
    """Texture of a few pixels and more, grey levels 128 give or take 40."""
    rng = np.random.default_rng(seed)
    blurred = cv2.GaussianBlur(np.tile(rng.normal(size=(rows, columns)), 3), (0, 0), 3.0)[:, columns : 2 * columns]
    return (128.0 + 40.0 * blurred / blurred.std()).astype(np.float32)


def noisy(image: np.ndarray, sd: float, seed: int = 0) -> np.ndarray:
    return (image + np.random.default_rng([seed, 1]).normal(0.0, sd, image.shape)).astype(np.float32)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 1.0])
def test_the_share_of_noise_is_what_was_added(share: float, seed: int) -> None:
    image = clouds(seed)
    along, across = np.gradient(image, axis=1)[1:-1], np.gradient(image, axis=0)[1:-1]
    energy = float(np.mean(np.square(along) + np.square(across)))
    if share == 1.0:
        image, variance = np.full_like(image, 128.0), 100.0
    else:
        # Noise of variance v adds v to the energy of central differences.
        variance = share / (1.0 - share) * energy
    assert noise_share(panorama(noisy(image, np.sqrt(variance), seed))) == pytest.approx(share, abs=0.07)


def test_what_nobody_sees_has_no_noise() -> None:
    image = noisy(clouds(0), 20.0)
    image[:, 60:120] = 128.0
    seen = np.ones(image.shape, dtype=bool)
    seen[:, 60:120] = False
    assert noise_share(panorama(image, seen)) > 1.5 * noise_share(panorama(clouds(0), seen))
    assert noise_share(panorama(image, np.zeros(image.shape, dtype=bool))) == 0.0


@given(st.integers(0, 1000), st.floats(0.0, 2.0))
@settings(max_examples=20, deadline=None)
def test_clear_images_stay_as_they_are(seed: int, sd: float) -> None:
    image = panorama(noisy(clouds(seed), sd, seed))
    assert quiet(image) is image


@pytest.mark.parametrize("masked", [False, True])
def test_an_image_of_more_noise_than_world_comes_nearer_to_the_world(masked: bool) -> None:
    world = clouds(1)
    seen = np.ones(world.shape, dtype=bool)
    seen[:, 60:75] = not masked
    image = noisy(world, 60.0)
    image[~seen] = 0.0
    found = quiet(panorama(image, seen if masked else None))
    assert np.abs(found.pixels - world)[seen].mean() < 0.4 * np.abs(image - world)[seen].mean()
    assert not found.pixels[~seen].any()
    assert (found.valid is None) == (not masked)


@given(st.integers(-200, 200))
@settings(max_examples=10, deadline=None)
def test_turning_a_noisy_image_turns_what_is_left_of_it(columns: int) -> None:
    image = noisy(clouds(2), 60.0)
    found = quiet(panorama(np.roll(image, columns, axis=1))).pixels
    assert np.allclose(found, np.roll(quiet(panorama(image)).pixels, columns, axis=1), atol=1e-3)

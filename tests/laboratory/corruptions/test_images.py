from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.laboratory.corruptions import bars, blobs, blur, gain, lean, noise, random_pixels, spatial_light, tilt

FIELD = {"elevation_deg": (-50.0, 25.0)}
NOISELESS = {"full_well": 0.0}

#: Each function with a severity that changes something, and one that changes nothing.
EVERY: dict[str, tuple[Callable[..., np.ndarray], dict[str, Any], dict[str, Any]]] = {
    "random_pixels": (random_pixels, {"share": 0.3}, {"share": 0.0}),
    "bars": (bars, {"share": 0.3}, {"share": 0.0}),
    "blobs": (blobs, {"share": 0.3}, {"share": 0.0}),
    "gain": (gain, {"factor": 0.35}, {"factor": 1.0}),
    "spatial_light": (spatial_light, {}, {"log_sd": 0.0, "gain": 1.0, "full_well": 0.0}),
    "blur": (blur, {"sigma": 1.5}, {"sigma": 0.0}),
    "tilt": (tilt, {"degrees": 4.0, **FIELD}, {"degrees": 0.0, **FIELD}),
    "lean": (lean, {"pitch_deg": 2.0, "roll_deg": -1.0, **FIELD}, {"pitch_deg": 0.0, "roll_deg": 0.0, **FIELD}),
    "noise": (noise, {"sd": 5.0}, {"sd": 0.0}),
}

shares = st.floats(0.0, 1.0)
seeds = st.integers(0, 2**32 - 1)
shapes = st.sampled_from([(1, 4), (2, 5), (9, 16), (12, 36), (7, 20, 1), (6, 24, 3)])


def image_of(shape, seed=0):
    return np.random.default_rng(seed).integers(1, 255, shape, dtype=np.uint8)


def changed(before, after):
    """Which pixels differ in any channel."""
    differs = before != after
    return differs if differs.ndim == 2 else differs.any(axis=2)


def runs_of(columns):
    """Stretches of true columns on a circle."""
    return int(np.sum(columns & ~np.roll(columns, 1))) if not columns.all() else 1


@pytest.mark.parametrize("name", EVERY)
class TestEveryOne:
    @given(shape=shapes, seed=seeds)
    @settings(max_examples=15, deadline=None)
    def test_shape_type_and_the_image_itself_are_kept(self, name, shape, seed):
        function, severity, _ = EVERY[name]
        image = image_of(shape, seed)
        before = image.copy()
        corrupted = function(image, np.random.default_rng(seed), **severity)
        assert corrupted.shape == shape
        assert corrupted.dtype == np.uint8
        assert not np.shares_memory(corrupted, image)
        np.testing.assert_array_equal(image, before)

    @given(shape=shapes, seed=seeds)
    @settings(max_examples=15, deadline=None)
    def test_no_severity_changes_nothing(self, name, shape, seed):
        function, _, nothing = EVERY[name]
        image = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
        corrupted = function(image, np.random.default_rng(seed), **nothing)
        np.testing.assert_array_equal(corrupted, image)
        assert not np.shares_memory(corrupted, image)

    def test_the_seed_decides(self, name):
        function, severity, _ = EVERY[name]
        image = image_of((24, 72))
        first, again, other = (function(image, np.random.default_rng(seed), **severity) for seed in (3, 3, 4))
        np.testing.assert_array_equal(first, again)
        assert (name in ("gain", "blur", "lean")) == np.array_equal(first, other)
        assert not np.array_equal(first, image)

    def test_an_image_that_is_not_contiguous(self, name):
        function, severity, _ = EVERY[name]
        image = image_of((24, 72))
        whole = function(image, np.random.default_rng(0), **severity)
        np.testing.assert_array_equal(function(np.asfortranarray(image), np.random.default_rng(0), **severity), whole)


@given(shape=shapes, share=shares, seed=seeds)
@settings(max_examples=60, deadline=None)
def test_random_pixels_change_as_many_as_asked(shape, share, seed):
    image = image_of(shape, seed)
    corrupted = random_pixels(image, np.random.default_rng(seed), share)
    assert changed(image, corrupted).sum() == round(share * shape[0] * shape[1])


def test_random_pixels_take_all_values_alike():
    corrupted = random_pixels(np.full((200, 360), 7, np.uint8), np.random.default_rng(0), 1.0)
    counts = np.bincount(corrupted.ravel(), minlength=256)
    assert counts[7] == 0
    assert np.delete(counts, 7).min() > 0.7 * corrupted.size / 255


@given(shape=shapes, share=shares, count=st.integers(1, 8), seed=seeds)
@settings(max_examples=100, deadline=None)
def test_bars_cover_whole_columns_as_asked(shape, share, count, seed):
    image = image_of(shape, seed)
    corrupted = bars(image, np.random.default_rng(seed), share, count)
    black = changed(image, corrupted)
    covered = round(share * shape[1])
    assert (black == black[0]).all()
    assert black[0].sum() == covered
    assert (corrupted[:, black[0]] == 0).all()
    if covered:
        assert runs_of(black[0]) == min(count, covered, max(shape[1] - covered, 1))


def test_bars_lie_anywhere_also_across_the_seam():
    image = np.full((2, 60), 9, np.uint8)
    black = np.stack([bars(image, np.random.default_rng(seed), 0.5)[0] == 0 for seed in range(400)])
    # 50 % of the columns, each as likely as any other: standard deviation 0.025.
    assert np.abs(black.mean(axis=0) - 0.5).max() < 0.1
    across = (black[:, 0] & black[:, -1]).mean()
    assert across == pytest.approx((black[:, 30] & black[:, 31]).mean(), abs=0.1)


@given(shape=shapes, share=shares, seed=seeds)
@settings(max_examples=60, deadline=None)
def test_blobs_cover_as_much_as_asked_in_one_grey(shape, share, seed):
    image = np.zeros(shape, np.uint8)
    covered = changed(image, corrupted := blobs(image, np.random.default_rng(seed), share))
    assert covered.sum() == round(share * shape[0] * shape[1])
    assert len(np.unique(corrupted[covered])) <= 1


def test_blobs_hang_together_across_the_seam():
    image = np.zeros((60, 360), np.uint8)
    covered = np.stack([blobs(image, np.random.default_rng(seed), 0.5) > 0 for seed in range(10)])
    breaks = (covered != np.roll(covered, 1, axis=2)).mean(axis=(0, 1))
    assert breaks.mean() < 0.05
    assert breaks[0] < 0.1


def test_gain_multiplies_rounds_and_saturates():
    image = np.array([[0, 10, 101, 255]], np.uint8)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(gain(image, rng, 2.2), [[0, 22, 222, 255]])
    np.testing.assert_array_equal(gain(image, rng, 0.35), [[0, 4, 35, 89]])
    assert not gain(image, rng, 0.0).any()


def test_the_spread_of_spatial_light_is_as_asked():
    image = np.full((145, 360), 200, np.uint8)
    lit = spatial_light(image, np.random.default_rng(1), log_sd=0.3, gain=0.4, **NOISELESS)
    logarithm = np.log(lit / 200.0)
    assert logarithm.mean() == pytest.approx(np.log(0.4), abs=0.01)
    assert logarithm.std() == pytest.approx(0.3, abs=0.01)


def test_spatial_light_is_smooth_also_across_the_seam():
    image = np.full((145, 360), 200, np.uint8)
    lit = spatial_light(image, np.random.default_rng(2), log_sd=0.6, gain=0.2, **NOISELESS).astype(float)
    steps = np.abs(lit - np.roll(lit, 1, axis=1)).max(axis=0)
    assert steps[0] <= steps[1:].max() + 1.0
    assert steps.max() <= 6.0


def test_camera_noise_is_that_of_electrons():
    image = np.full((145, 360), 200, np.uint8)
    lit = spatial_light(image, np.random.default_rng(3), log_sd=0.0, gain=0.5, full_well=1000.0, read_noise=8.0)
    electrons = 100.0 * 1000.0 / 255.0
    assert lit.mean() == pytest.approx(100.0, abs=0.1)
    # Shot and read noise, and the rounding to whole levels.
    assert lit.std() == pytest.approx(np.sqrt((electrons + 64.0) * 0.255**2 + 1.0 / 12.0), rel=0.02)


@pytest.mark.parametrize("function", [blur, noise])
def test_mean_grey_level_stays(function):
    image = image_of((60, 180)) // 2 + 60
    assert function(image, np.random.default_rng(0), 3.0).mean() == pytest.approx(image.mean(), abs=0.2)


@given(turn=st.integers(0, 35), sigma=st.floats(0.1, 6.0))
@settings(max_examples=30, deadline=None)
def test_blur_turns_with_the_image(turn, sigma):
    image = image_of((12, 36))
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(
        blur(np.roll(image, turn, axis=1), rng, sigma), np.roll(blur(image, rng, sigma), turn, axis=1)
    )


def test_channels_stay_apart_in_a_blur():
    image = np.zeros((12, 36, 3), np.uint8)
    image[..., 1] = 100
    np.testing.assert_array_equal(blur(image, np.random.default_rng(0), 2.0), image)


def test_noise_has_the_spread_asked_for():
    noisy = noise(np.full((100, 360), 128, np.uint8), np.random.default_rng(0), 6.0).astype(float)
    assert noisy.std() == pytest.approx(6.0, rel=0.02)


def seen_from(rotation, rows=150, columns=360, bottom=-50.0, top=25.0):
    """Grey levels of a world that is a smooth function of the direction, as a camera turned by a rotation sees it."""
    elevation = np.radians(top - (np.arange(rows) + 0.5) * (top - bottom) / rows)[:, None]
    azimuth = -2.0 * np.pi * np.arange(columns)[None, :] / columns
    along = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation) + 0.0 * azimuth
    x, y, z = np.tensordot(rotation, np.stack(along), axes=1)
    return 128.0 + 50.0 * np.sin(3.0 * x + 1.0) + 40.0 * np.sin(4.0 * y) + 30.0 * np.cos(5.0 * z + 2.0 * x)


@given(pitch=st.floats(-8.0, 8.0), roll=st.floats(-8.0, 8.0))
@settings(max_examples=30, deadline=None)
def test_lean_turns_every_ray(pitch, roll):
    upright = np.rint(seen_from(np.eye(3))).astype(np.uint8)
    turned = lean(upright, np.random.default_rng(0), pitch, roll, (-50.0, 25.0))
    angle = np.radians(np.hypot(pitch, roll))
    axis = np.radians([roll, pitch, 0.0]) / max(angle, 1e-12)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    # Away from the rim, beyond which nothing is known.
    inside = slice(26, -26)
    np.testing.assert_allclose(turned[inside], seen_from(rotation)[inside], atol=1.6)


def test_a_nose_that_is_down_sees_the_floor_higher_up_in_front():
    image = np.broadcast_to(np.arange(150, dtype=np.uint8)[:, None], (150, 72))
    down = lean(image, np.random.default_rng(0), 4.0, 0.0, (-50.0, 25.0))[75].astype(int) - 75
    assert (down[0], down[36]) == (8, -8)
    right = lean(image, np.random.default_rng(0), 0.0, 4.0, (-50.0, 25.0))[75].astype(int) - 75
    assert (right[18], right[54]) == (8, -8)


@given(degrees=st.floats(0.5, 8.0), seed=seeds)
@settings(max_examples=30, deadline=None)
def test_tilt_is_as_large_as_asked(degrees, seed):
    ramp = np.broadcast_to(np.rint(1.63 * np.arange(150)).astype(np.uint8)[:, None], (150, 72))
    tilted = tilt(ramp, np.random.default_rng(seed), degrees, (-50.0, 25.0))
    # Along the horizon the rows move sinusoidally.
    wave = np.fft.rfft(tilted[49:51].astype(float).mean(axis=0)) / 72
    assert 2.0 * abs(wave[1]) / 1.63 == pytest.approx(2.0 * degrees, abs=0.2)


def test_tilt_leans_anywhere():
    ramp = np.broadcast_to(np.arange(150, dtype=np.uint8)[:, None], (150, 72))
    lowest = [int(np.argmin(tilt(ramp, np.random.default_rng(seed), 8.0, (-50.0, 25.0))[75])) for seed in range(40)]
    assert len({column // 18 for column in lowest}) == 4

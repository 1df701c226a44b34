"""A camera off the turning centre, found from poses that a formula gives."""

import numpy as np
import pytest

from panoloc_mcl.robot.geometry import between, compose, interpolate_at
from panoloc_mcl.tools.calibration.odometry import place_camera, pooled

MOUNT = np.array([0.15, 0.05, 0.0])


def drive(turns: bool, seconds: float = 30.0):
    """Base poses at 20 Hz, curved or straight."""
    times = np.arange(0.0, seconds, 0.05)
    rate = 0.5 * np.sin(0.7 * times) + 0.3 * np.cos(0.31 * times) if turns else np.zeros_like(times)
    heading = np.cumsum(rate) * 0.05
    x, y = np.cumsum(0.2 * np.cos(heading)) * 0.05, np.cumsum(0.2 * np.sin(heading)) * 0.05
    return times, np.stack([x, y, heading], axis=-1)


def seen(base, times, at, rng, shift=0.0):
    """Where images say that the camera was, 2 mm and 0.02 degrees rms off, their stamps late by ``shift``."""
    poses = compose(interpolate_at(times, base, at), MOUNT)
    poses[:, 2] = interpolate_at(times, base, at)[:, 2]
    return at - shift, poses + rng.normal(size=poses.shape) * [0.002, 0.002, np.radians(0.02)]


def test_the_offset_is_found_to_five_millimetres_with_noisy_odometry() -> None:
    rng = np.random.default_rng(4)
    times, base = drive(turns=True)
    stamps, poses = seen(base, times, np.arange(1.0, 29.0, 0.8), rng)
    # Odometry in a frame of its own, 3 % long.
    odometry = compose([5.0, -3.0, 1.2], base * [1.03, 1.03, 1.0])
    found = place_camera(stamps, poses, times, odometry)
    assert found is not None
    assert (found.x_m, found.y_m) == pytest.approx((0.15, 0.05), abs=0.005)
    assert found.sd_m < 0.005
    assert abs(found.yaw) < np.radians(0.5)
    assert found.odometry_scale == pytest.approx(1.0 / 1.03, abs=0.01)
    assert abs(found.time_offset_s) < 3.0 * found.sd_time_s + 0.003


def test_late_stamps_are_noticed() -> None:
    times, base = drive(turns=True)
    stamps, poses = seen(base, times, np.arange(1.0, 29.0, 0.8), np.random.default_rng(5), shift=0.2)
    found = place_camera(stamps, poses, times, base)
    assert found is not None
    assert found.time_offset_s == pytest.approx(0.2, abs=0.02)
    assert (found.x_m, found.y_m) == pytest.approx((0.15, 0.05), abs=0.006)


def test_a_drive_that_never_turns_tells_nothing_of_the_offset() -> None:
    times, base = drive(turns=False)
    stamps, poses = seen(base, times, np.arange(1.0, 29.0, 0.8), np.random.default_rng(6))
    found = place_camera(stamps, poses, times, base)
    assert found is not None
    assert found.sd_m > 0.05


def test_a_few_images_are_not_enough() -> None:
    times, base = drive(turns=True)
    assert place_camera(times[:5], base[:5], times, base) is None


@pytest.mark.parametrize("seed", range(4))
def test_wheels_that_slip_along_the_way_cost_little(seed: int) -> None:
    """Lengths off by a tenth and a heading that creeps: what leads aside is still told by the headings of the images."""
    rng = np.random.default_rng(seed)
    times, base = drive(turns=True, seconds=40.0)
    stamps, poses = seen(base, times, np.arange(1.0, 39.0, 0.8), rng)
    steps = between(base[:-1], base[1:])
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    # A slip lasts as long as an image.
    steps[:, :2] *= 1.0 + 0.1 * np.repeat(rng.standard_normal(len(steps) // 16 + 1), 16)[: len(steps), None]
    steps[:, 2] += np.radians(1.0) * lengths
    path = [np.zeros(3)]
    for step in steps:
        path.append(compose(path[-1], step))
    found = place_camera(stamps, poses, times, np.array(path))
    assert found is not None
    assert abs(found.yaw) < np.radians(0.3)
    assert abs(found.x_m - 0.15) < min(0.005, 3.0 * found.sd_x_m)
    assert abs(found.y_m - 0.05) < 3.0 * found.sd_y_m


@pytest.mark.parametrize("jumps", [True, False])
def test_messages_that_are_rare_where_the_robot_stops_to_turn_cost_little(jumps: bool) -> None:
    """Straight on for two images, a turn on the spot for two, always to the left: what is cut off a corner looks like a lever.

    The speed changes at once as an image is taken, or over half a second.
    """
    fine = np.arange(0.0, 40.0, 0.01)
    spot = ((fine - 1.0) // 2.0) % 2 == 1
    speed, rate = np.where(spot, 0.0, 0.25), np.where(spot, 0.45, 0.0)
    if not jumps:
        speed, rate = (np.convolve(np.pad(one, 25, mode="edge"), np.ones(51) / 51.0, mode="valid") for one in (speed, rate))
    heading = np.concatenate([[0.0], np.cumsum(rate[:-1])]) * 0.01
    x, y = (np.concatenate([[0.0], np.cumsum(speed[:-1] * part(heading[:-1]))]) * 0.01 for part in (np.cos, np.sin))
    base = np.stack([x, y, heading], axis=-1)
    messages = np.arange(0.03, 39.9, 0.16)
    stamps, poses = seen(base, fine, np.arange(1.0, 39.0, 1.0), np.random.default_rng(7))
    found = place_camera(stamps, poses, messages, interpolate_at(fine, base, messages))
    assert found is not None
    assert abs(found.x_m - 0.15) < 0.005
    assert abs(found.y_m - 0.05) < min(0.005, 3.0 * found.sd_y_m)


def test_measurements_that_contradict_each_other_are_not_believed_to_the_millimetre() -> None:
    agreed, sd = pooled([0.05, 0.052], [0.002, 0.002])
    assert (agreed, sd) == pytest.approx((0.051, 0.002 / np.sqrt(2.0)))
    _, wide = pooled([0.05, 0.07], [0.002, 0.002])
    assert wide == pytest.approx(0.01)
    assert pooled([0.05, 1.0], [0.002, np.inf]) == pytest.approx((0.05, 0.002))
    assert pooled([0.0, 0.0], [np.inf, np.inf])[1] == np.inf

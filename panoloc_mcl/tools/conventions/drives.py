"""Conventions of a drive: odometry and truth by their own images, and how far their clock is off."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference, between
from panoloc_mcl.tools.conventions.motion_table import BEARINGS, Views
from panoloc_mcl.tools.conventions.readings import (
    AS_WRITTEN,
    CLOCKWISE,
    DEGREES,
    STILL,
    SWAPPED,
    Fit,
    Reading,
    best_fit,
    heading_off,
)
from panoloc_mcl.tools.datasets import Sequence, Trajectory

Float64 = NDArray[np.float64]

_MOST_PAIRS = 30
# Between two images of a pair the robot drives so far at the least, if it drives at all, metres; and at the most.
_STEP_M, _FAR_M = 0.15, 2.5
_UNITS = ((0.01, "centimetres"), (0.001, "millimetres"))
# Clocks are compared over so many seconds to either side, in such steps; turns that stand out by less are not looked at.
_OFFSETS_S, _OFFSET_STEP_S, _CLEAR = 15.0, 0.05, 0.1
# An offset is told if it is more than this, seconds, and turns then fit so much better, in standard errors and as a share.
_LEAST_OFFSET_S, _LEAST_ERRORS, _LEFT = 0.2, 3.0, 0.5
# Of the turns so many must lie within the other clock's time.
_OVERLAP = 0.4
# Turns that differ by more are no worse for it, radians.
_MOST_OFF = math.radians(20.0)
_TURNS, _STILL = math.radians(3.0), math.radians(0.3)
_READINGS = (
    AS_WRITTEN,
    # Before degrees: what is turned by a few of them hardly turns, so degrees are only named if they tell more than no turns at all.
    *STILL,
    DEGREES,
    CLOCKWISE,
    Reading(
        "mirrored",
        "its turns and ways fit mirrored, as the images have them",
        "write y and theta with the other sign, or see whether these images are mirrored",
        mirrored=True,
    ),
    SWAPPED,
    *(heading_off((360.0 * step / BEARINGS + 180.0) % 360.0 - 180.0) for step in range(1, BEARINGS)),
)


@dataclass(frozen=True)
class Offset:
    """How far two clocks are apart.

    Parameters
    ----------
    seconds : float
        Add this to the stamps of images to bring them to odometry's clock.
    before_deg, after_deg : float
        Mean difference of turns by odometry and by images, as written and with it.
    """

    seconds: float
    before_deg: float
    after_deg: float


def drive_findings(drive: Sequence, most_pairs: int = _MOST_PAIRS) -> list[str]:
    """One line for a convention of a drive that fits far better than what is written; empty where none does.

    Parameters
    ----------
    drive : Sequence
    most_pairs : int
        So many pairs of its images are looked at, evenly over the drive.
    """
    lines = []
    for trajectory, name in ((drive.odometry, "odometry.tum"), (drive.groundtruth, "groundtruth.tum")):
        if trajectory is None:
            continue
        where = str(drive.path / name)
        fit, offset, never_turns = trajectory_fit(drive, trajectory, most_pairs)
        if never_turns:
            lines.append(f"{where}: its heading never changes, though the images turn; write the rotation (qx qy qz qw)")
        elif fit is not None:
            lines.append(fit.line(where))
        elif offset is not None:
            lines.append(
                f"{where}: its clock fits {offset.seconds:+.2f} s from that of the images (turns differ by {offset.after_deg:.1f} "
                f"instead of {offset.before_deg:.1f} degrees); write camera.time_offset_s: {offset.seconds:.2f}, or use one clock"
            )
        if lines:
            break
    return lines


def trajectory_fit(
    drive: Sequence, trajectory: Trajectory, most_pairs: int = _MOST_PAIRS
) -> tuple[Fit | None, Offset | None, bool]:
    """The reading of a trajectory that fits the drive's images far better, how far its clock is off, and whether it never turns."""
    poses = trajectory.at(drive.times)
    inside = (drive.times >= trajectory.times[0]) & (drive.times <= trajectory.times[-1])
    speed = _usual_speed(trajectory)
    scale = next((factor for factor, _ in _UNITS if speed * factor < 5.0), 1.0) if speed > 15.0 else 1.0
    pairs = _pairs(poses * [scale, scale, 1.0], inside, most_pairs)
    views = Views(drive.camera, drive.image_size, drive.files)
    first, second = (np.array([pair[side] for pair in pairs], dtype=np.int64) for side in (0, 1))
    moved = between(poses[first], poses[second]) if pairs else np.zeros((0, 3))
    distances = np.hypot(moved[:, 0], moved[:, 1])
    usable = views.usable(pairs)
    pairs, moved, distances = [pairs[number] for number in usable], moved[usable], distances[usable]
    if not pairs:
        return None, None, False
    table = views.table(pairs, np.minimum(distances * scale, 50.0))
    if scale == 1.0:
        # As turns went on: a rotation holds degrees without their whole turns of 2 pi, of which 12 degrees are two.
        went_on = np.column_stack([poses[:, :2], np.interp(drive.times, trajectory.times, np.unwrap(trajectory.poses[:, 2]))])
        scores = []
        for reading in _READINGS:
            scores.append((reading, reading.agreement(table, went_on if reading is DEGREES else poses, pairs)))
        fit = best_fit(scores)
    else:
        units = [(Reading(unit, f"x and y fit as {unit}", "write metres"), factor) for factor, unit in _UNITS]
        scores = [(reading, views.along(pairs, moved, factor)) for reading, factor in units]
        fit = best_fit([(AS_WRITTEN, views.along(pairs, moved)), *scores])
    turned, clear = table.turns()
    written = moved[:, 2]
    still = len(written) > 0 and float(np.abs(written).max()) < _STILL
    if still and float(np.quantile(np.abs(turned), 0.75)) > _TURNS:
        return None, None, True
    offset = None
    if fit is None or fit.reading.kind in ("heading off", STILL[0].kind):
        offset = _clock_offset(drive, trajectory, pairs, turned, clear)
    return (None if offset is not None else fit), offset, False


def _pairs(poses: Float64, inside: NDArray[np.bool_], most: int) -> list[tuple[int, int]]:
    """Images one after the other, far enough apart to tell something, evenly over the drive."""
    found, last = [], 0
    for index in range(1, len(poses)):
        if not inside[last]:
            last = index
            continue
        step = between(poses[last], poses[index])
        far = math.hypot(step[0], step[1])
        if inside[index] and (far >= _STEP_M or abs(step[2]) > _TURNS):
            if far <= _FAR_M:
                found.append((last, index))
            last = index
    if not found:
        return []
    chosen = np.unique(np.linspace(0, len(found) - 1, min(most, len(found))).round().astype(np.int64))
    return [found[number] for number in chosen]


def _usual_speed(trajectory: Trajectory) -> float:
    """Upper quartile of its speeds, metres a second."""
    if len(trajectory) < 2:
        return 0.0
    steps = np.hypot(*np.diff(trajectory.poses[:, :2], axis=0).T) / np.diff(trajectory.times)
    return float(np.quantile(steps, 0.75))


def _clock_offset(
    drive: Sequence, trajectory: Trajectory, pairs: list[tuple[int, int]], turned: Float64, clear: Float64
) -> Offset | None:
    """How far the images' clock is off, told by when both turn."""
    sure = clear > _CLEAR
    if sure.sum() < 8:
        return None
    begin, end = (drive.times[[pair[side] for pair in pairs]][sure] for side in (0, 1))
    offsets = np.arange(-_OFFSETS_S, _OFFSETS_S + 1e-9, _OFFSET_STEP_S)
    low, high = trajectory.times[0], trajectory.times[-1]
    costs = np.full((len(offsets), int(sure.sum())), np.nan)
    for row, offset in enumerate(offsets):
        known = (begin + offset >= low) & (end + offset <= high)
        turns = between(trajectory.at(begin + offset), trajectory.at(end + offset))[:, 2]
        off = np.minimum(np.abs(angle_difference(turns, turned[sure])), _MOST_OFF)
        costs[row] = np.where(known, off, np.nan)
    counted = np.isfinite(costs).sum(axis=1) >= max(8, int(_OVERLAP * sure.sum()))
    if not counted.any():
        return None
    means = np.where(counted, np.nanmean(np.where(counted[:, None], costs, 0.0), axis=1), np.inf)
    best, written = int(np.argmin(means)), int(np.argmin(np.abs(offsets)))
    if abs(offsets[best]) <= _LEAST_OFFSET_S or not counted[written]:
        return None
    gain = (costs[written] - costs[best])[np.isfinite(costs[written] - costs[best])]
    error = float(gain.std(ddof=1)) / math.sqrt(len(gain))
    if gain.mean() < _LEAST_ERRORS * error or means[best] > _LEFT * means[written] or means[written] < math.radians(1.0):
        return None
    return Offset(float(offsets[best]), math.degrees(means[written]), math.degrees(means[best]))

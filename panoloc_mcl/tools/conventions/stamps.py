"""Units of time stamps, and images too far apart to be used: told by the stamps alone."""

from __future__ import annotations

import numpy as np

from panoloc_mcl.robot.motion import ImageClock, OdometryBuffer
from panoloc_mcl.robot.motion.measured import unit_of
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.localizer import MotionSettings
from panoloc_mcl.tools.datasets import Sequence

# Clocks whose spans differ by such a factor, within a third, count in different units.
_FACTORS = ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds"))
_WITHIN = 1.0 / 3.0
# A robot that takes minutes from image to image and creeps along counts in smaller units.
_LONG_S, _SLOW_M_S = 20.0, 0.005
# Where so many of its images are left out, a drive is of no use.
_MOST_LEFT_OUT = 0.5


def stamp_findings(drive: Sequence, motion: MotionSettings | None = None) -> list[str]:
    """One line where the stamps of images or odometry are no seconds, or most images would be left out for theirs; else empty.

    Parameters
    ----------
    drive : Sequence
    motion : MotionSettings, optional
        Of the run; the usual ones if left out.
    """
    frames, odometry = drive.path / "frames.csv", drive.path / "odometry.tum"
    stamps = [(frames, drive.times)] + ([(odometry, drive.odometry.times)] if drive.odometry is not None else [])
    if drive.odometry is not None and len(drive.times) > 2 and len(drive.odometry) > 2:
        one, other = float(np.ptp(drive.times)), float(np.ptp(drive.odometry.times))
        for factor, unit in _FACTORS:
            for path, longer, shorter in ((frames, one, other), (odometry, other, one)):
                if abs(longer / shorter / factor - 1.0) < _WITHIN:
                    return [
                        f"{path}: stamps fit as {unit} ({longer:g} where the other clock counts {shorter:g}); write seconds"
                    ]
    for path, times in stamps:
        if unit := unit_of(float(times[-1])):
            return [f"{path}: stamps such as {times[-1]:.0f} fit as {unit}; write seconds"]
    if drive.odometry is None:
        return _too_far_apart(drive, motion or MotionSettings())
    other = float(np.ptp(drive.odometry.times))
    way = float(np.hypot(*np.diff(drive.odometry.poses[:, :2], axis=0).T).sum())
    if float(np.median(np.diff(drive.times))) > _LONG_S and 0.1 < way < _SLOW_M_S * other:
        return [
            f"{frames}: stamps fit as milliseconds (images {np.median(np.diff(drive.times)):.0f} s apart at {way / other:.4f} m/s); "
            "write seconds, in odometry.tum as well"
        ]
    return []


def _too_far_apart(drive: Sequence, settings: MotionSettings) -> list[str]:
    """Without odometry: as the clock of a run has it."""
    clock = ImageClock(settings, OdometryBuffer(settings))
    left_out = 0
    for stamp in drive.times.tolist():
        clock.set_back(stamp)
        if problem := clock.problem(stamp):
            left_out += problem.reason is Reason.STAMP_AHEAD
            continue
        clock.follow(stamp)
        clock.fuse(stamp)
    if left_out <= _MOST_LEFT_OUT * len(drive):
        return []
    gaps = np.diff(drive.times)
    return [
        f"{drive.path / 'frames.csv'}: images lie {np.median(gaps):.0f} s apart in the median (at most {gaps.max():.0f} s) without "
        f"odometry: {left_out} of {len(drive)} would be left out, as jumps of the clock; give odometry.tum, or set "
        f"localizer.motion.clock_jump_s (now {settings.clock_jump_s:g}) to more than that"
    ]

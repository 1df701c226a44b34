"""Trajectories in the plane and their TUM files (``timestamp tx ty tz qx qy qz qw``)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.files import text_of, write_atomically
from panoloc_mcl.robot.geometry import interpolate_at, yaw_from_quaternion

FloatArray = NDArray[np.float64]

_HEADER = "# timestamp tx ty tz qx qy qz qw"
_UNIT_TOLERANCE = 1e-3
_MOST_FAULTS = 20
_HOLE_S, _SAME_TIME_S = 2.0, 1e-3
# Cosine of the tilt that no driving robot has for half of the time.
_LEAST_UPWARD = 0.5


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses over time.

    Parameters
    ----------
    times : ndarray of float64, shape (n,)
        Seconds, strictly increasing; at least one.
    poses : ndarray of float64, shape (n, 3)
        ``(x, y, theta)``, metres and radians.

    Raises
    ------
    DatasetError
        Wrong shapes, values that are not finite, or times that do not increase.
    """

    times: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        times = np.ascontiguousarray(self.times, dtype=np.float64)
        poses = np.ascontiguousarray(self.poses, dtype=np.float64)
        if times.ndim != 1 or len(times) == 0 or poses.shape != (len(times), 3):
            raise DatasetError(f"trajectory: times {times.shape} and poses {poses.shape} must be (n,) and (n, 3), n >= 1")
        if not (np.isfinite(times).all() and np.isfinite(poses).all()):
            raise DatasetError("trajectory: holds values that are not finite; leave those rows out")
        if np.any(np.diff(times) <= 0.0):
            row = int(np.argmax(np.diff(times) <= 0.0)) + 1
            raise DatasetError(f"trajectory: time {times[row]:.9f} of row {row} does not increase; sort and drop doubles")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)

    def __len__(self) -> int:
        return len(self.times)

    def at(self, times: ArrayLike) -> FloatArray:
        """Poses at given times (seconds, any shape), linear between rows; the ends hold outside. Shape (..., 3)."""
        return interpolate_at(self.times, self.poses, times)


def truth_at(trajectory: Trajectory, times: FloatArray) -> FloatArray:
    """True poses at the times (n,) of frames, (n, 3); not a number where none is known: outside the trajectory, and in its holes.

    A hole is longer than two seconds and than five times the usual interval: a robot may do anything in it.
    """
    known_at = trajectory.times
    poses = trajectory.at(times)
    right = np.clip(np.searchsorted(known_at, times - _SAME_TIME_S), 0, len(known_at) - 1)
    left = np.clip(right - 1, 0, None)
    nearest = np.minimum(np.abs(known_at[right] - times), np.abs(known_at[left] - times))
    inside = (times >= known_at[0]) & (times <= known_at[-1])
    usual = float(np.median(np.diff(known_at))) if len(known_at) > 1 else 0.0
    in_hole = known_at[right] - known_at[left] > max(_HOLE_S, 5.0 * usual)
    poses[(~inside | in_hole) & (nearest > _SAME_TIME_S)] = np.nan
    return poses


def read_tum(path: Path) -> Trajectory:
    """Read a TUM file; of the rotation only the turn about the vertical is kept.

    Raises
    ------
    DatasetError
        Every fault, one line each: missing file, wrong number of columns, values that are no finite numbers, quaternions
        that are not of unit length, time stamps that do not increase, no poses at all.
    """
    try:
        text = text_of(path, DatasetError)
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error}); check permissions") from error
    rows: list[list[float]] = []
    faults: list[str] = []
    last = -math.inf
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split("#", 1)[0].replace(",", " ").split()
        if not fields:
            continue
        row = _parsed(fields, f"{path}:{number}", faults)
        if row is None:
            continue
        if row[0] <= last:
            faults.append(
                f"{path}:{number}: timestamp {fields[0]} does not increase (before it {last:.9f}); sort, drop doubles"
            )
        last = max(last, row[0])
        rows.append(row)
    if not rows and not faults:
        faults.append(f"{path}: holds no poses; needs lines 'timestamp tx ty tz qx qy qz qw'")
    if faults:
        more = len(faults) - _MOST_FAULTS
        raise DatasetError(faults[:_MOST_FAULTS] + ([f"{path}: and {more} more faulty lines like these"] if more > 0 else []))
    table = np.asarray(rows, dtype=np.float64)
    norm = np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    lying = _lying(table[:, 4:] / norm)
    if lying:
        raise DatasetError(f"{path}: {lying}")
    yaw = yaw_from_quaternion(*(table[:, 4:] / norm).T)
    return Trajectory(table[:, 0], np.column_stack([table[:, 1:3], yaw]))


def _parsed(fields: list[str], where: str, faults: list[str]) -> list[float] | None:
    if len(fields) != 8:
        faults.append(f"{where}: {len(fields)} columns; must be 8: timestamp tx ty tz qx qy qz qw")
        return None
    try:
        row = [float(field) for field in fields]
    except ValueError:
        bad = next(field for field in fields if not _is_number(field))
        faults.append(f"{where}: '{bad}' is not a number; mend or drop this line")
        return None
    if not all(math.isfinite(value) for value in row):
        bad = next(field for field, value in zip(fields, row, strict=True) if not math.isfinite(value))
        faults.append(f"{where}: value {bad} is not finite; drop this line")
        return None
    norm = math.sqrt(sum(value * value for value in row[4:]))
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        faults.append(f"{where}: quaternion has length {norm:.6g}; must be 1: normalise it, order qx qy qz qw")
        return None
    return row


def _lying(quaternions: FloatArray) -> str:
    """What is wrong with rotations (n, 4) that lay a robot on its side or on its head; empty for those of a robot that drives."""
    if float(np.median(_upward(quaternions))) > _LEAST_UPWARD:
        return ""
    if float(np.median(_upward(quaternions[:, [1, 2, 3, 0]]))) > _LEAST_UPWARD:
        return "quaternions fit with w first; write them as qx qy qz qw"
    # Downward part of the y axis, which is the whole of it for a camera that looks level along its z axis.
    x, y, z, w = quaternions.T
    if float(np.median(-2.0 * (y * z + w * x))) > _LEAST_UPWARD:
        return "rotations fit as those of a camera's optical axes (z ahead, y down); write those of the robot (x ahead, z up)"
    return "rotations lay the robot on its side; write the turn about z, which points up"


def _upward(quaternions: FloatArray) -> FloatArray:
    """Upward part of the robot's z axis, (n,)."""
    x, y, _, _ = quaternions.T
    return np.asarray(1.0 - 2.0 * (x * x + y * y))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write a TUM file, z = 0, nine decimals (twelve for the quaternion); atomically.

    Raises
    ------
    DatasetError
        The file cannot be written.
    """
    half = 0.5 * trajectory.poses[:, 2]
    lines = [_HEADER]
    for time, (x, y, _), qz, qw in zip(trajectory.times, trajectory.poses, np.sin(half), np.cos(half), strict=True):
        lines.append(f"{time:.9f} {x:.9f} {y:.9f} 0.000000000 0.000000000 0.000000000 {qz:.12f} {qw:.12f}")
    write_atomically(path, "\n".join(lines) + "\n")

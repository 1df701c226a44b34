"""What callers measure, in the units that the localizer works in: time stamps in seconds, poses in the plane."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import MeasurementError

Float64 = NDArray[np.float64]

#: Coordinates beyond this are no robot's, and doubles no longer tell millimetres there: metres.
FARTHEST_M = 1e8

# Since 1970 seconds count 1.8e9, and 1e11 lies in the year 5138.
_UNITS = ((1e17, "nanoseconds"), (1e14, "microseconds"), (1e11, "milliseconds"))


def seconds(stamp: Any) -> float:
    """A time stamp as seconds; not a number where it is none of a time.

    Parameters
    ----------
    stamp : float, or what says as much
        Any real number, an array of one, a ``datetime``, a NumPy ``datetime64``, or a ROS stamp (``sec`` and ``nanosec``, ``secs`` and
        ``nsecs``, or ``nanoseconds``).

    Raises
    ------
    MeasurementError
        Text, None, or whatever else tells no time.
    """
    if isinstance(stamp, float):
        return stamp
    if isinstance(stamp, datetime):
        return stamp.timestamp()
    if isinstance(stamp, np.datetime64):
        return math.nan if np.isnat(stamp) else float(stamp.astype("datetime64[ns]").astype(np.int64)) / 1e9
    for whole, rest in (("sec", "nanosec"), ("secs", "nsecs")):
        if hasattr(stamp, whole) and hasattr(stamp, rest):
            return float(getattr(stamp, whole)) + float(getattr(stamp, rest)) / 1e9
    if hasattr(stamp, "nanoseconds"):
        return float(stamp.nanoseconds) / 1e9
    if not isinstance(stamp, str | bytes | bool | None):
        try:
            return float(stamp.item() if isinstance(stamp, np.ndarray) else stamp)
        except OverflowError:
            return math.inf
        except (TypeError, ValueError):
            pass
    raise MeasurementError(f"time stamp = {_shown(stamp)}: is no number of seconds; give a float, or a datetime")


def unit_of(stamp: float) -> str:
    """What a stamp is counted in that cannot be seconds; empty where it can."""
    return next((unit for least, unit in _UNITS if abs(stamp) >= least and math.isfinite(stamp)), "")


def planar_pose(pose: Any, what: str) -> NDArray[np.float64]:
    """A pose as float64 (3,): x, y, heading; a copy. Its values may be anything.

    Raises
    ------
    MeasurementError
        No numbers, or not three of them.
    """
    try:
        values = np.array(pose, dtype=np.float64)
    except (TypeError, ValueError):
        raise MeasurementError(f"{what} = {_shown(pose)}: holds no numbers; give x, y, heading") from None
    if values.shape != (3,):
        hint = " (a quaternion's heading is geometry.yaw_from_quaternion)" if values.shape in ((4,), (6,), (7,)) else ""
        raise MeasurementError(f"{what} has shape {values.shape}; give three numbers, x, y, heading{hint}")
    return values


def is_possible(pose: NDArray[np.float64]) -> bool:
    """Whether a robot can be there: finite, and within `FARTHEST_M`."""
    return bool(np.isfinite(pose).all() and np.abs(pose[:2]).max() <= FARTHEST_M)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def usable(values: Float64 | None, shape: tuple[int, ...]) -> Float64 | None:
    """A copy of what came with a measurement, if it is of the right shape and finite."""
    if values is None:
        return None
    array = np.array(values, dtype=np.float64)
    return array if array.shape == shape and np.isfinite(array).all() else None


def along_arc(velocity: Float64, seconds: float) -> Float64:
    """Where a constant velocity leads: turning on the way, so along the chord of an arc."""
    forward, leftward, turning = (float(value) * seconds for value in velocity)
    half = 0.5 * turning
    chord = math.sin(half) / half if abs(half) > 1e-9 else 1.0
    c, s = math.cos(half), math.sin(half)
    return np.array([chord * (c * forward - s * leftward), chord * (s * forward + c * leftward), turning])

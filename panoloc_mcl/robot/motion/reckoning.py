"""Where the robot is between two images: the last answer carried on by odometry, fast enough for every odometry measurement."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.motion.models import NOISE_MODELS, Motion, blind, carried, grown, taken_apart
from panoloc_mcl.robot.motion.odometry import OdometryBuffer

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Anchor:
    """A pose that is known at a time.

    Parameters
    ----------
    timestamp : float
        Seconds.
    pose : float64 (3,)
    covariance : float64 (3, 3)
    """

    timestamp: float
    pose: Float64
    covariance: Float64


def carried_to(anchor: Anchor, odometry: OdometryBuffer, timestamp: float) -> tuple[Float64, Float64]:
    """Pose (3,) and covariance (3, 3) at a time, before or after the anchor's, with the noise of the way between.

    The same as `carried` along ``odometry.motion``, but for rounding; in numbers instead of arrays, as it is asked for often.
    """
    if timestamp == anchor.timestamp:
        return anchor.pose.copy(), anchor.covariance.copy()
    if timestamp < anchor.timestamp or odometry.settings.model == "stationary":
        return carried(anchor.pose, anchor.covariance, odometry.motion(anchor.timestamp, timestamp))
    motion = _motion_on(odometry, anchor.timestamp, timestamp)
    dx, dy, turn = motion.increment.tolist()
    x, y, heading = anchor.pose.tolist()
    c, s = math.cos(heading), math.sin(heading)
    # How far the robot went in the map frame.
    wx, wy = c * dx - s * dy, s * dx + c * dy
    pose = np.array([x + wx, y + wy, (heading + turn + math.pi) % (2.0 * math.pi) - math.pi])
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = anchor.covariance.tolist()
    # An error of the heading at the start swings the way round, as does one of the first turn.
    first, last = motion.sd_first_turn**2, motion.sd_last_turn**2
    along, across = motion.sd_along**2, motion.sd_across**2
    a, b = math.cos(heading + motion.first_turn), math.sin(heading + motion.first_turn)
    swung = tt + first
    xx += -2.0 * wy * xt + wy * wy * swung + a * a * along + b * b * across
    yy += 2.0 * wx * yt + wx * wx * swung + b * b * along + a * a * across
    xy += wx * xt - wy * yt - wx * wy * swung + a * b * (along - across)
    xt += -wy * swung
    yt += wx * swung
    return pose, np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, swung + last]])


def _motion_on(odometry: OdometryBuffer, start: float, end: float) -> Motion:
    """As ``odometry.motion`` forwards, from sums along the way that are kept."""
    settings = odometry.settings
    with odometry._lock:
        times = odometry._times
        if not times:
            return blind(taken_apart(np.zeros(3), 0.0, 0.0), end - start, settings)
        x0, y0, a0, way0, turned0 = _reading(odometry, start)
        x1, y1, a1, way1, turned1 = _reading(odometry, end)
        known_until = times[-1] + odometry._reach()
        oldest, newest = times[0], times[-1]
        growth = odometry._growth(start, end)
    c, s, dx, dy = math.cos(a0), math.sin(a0), x1 - x0, y1 - y0
    increment = np.array([c * dx + s * dy, c * dy - s * dx, math.remainder(a1 - a0, 2.0 * math.pi)])
    way, turned = way1 - way0, turned1 - turned0
    if start > newest:
        # Both ends are carried on beyond the newest measurement, and ways from there to each of them do not add up on an arc.
        way, turned = math.hypot(dx, dy), abs(float(increment[2]))
    known = NOISE_MODELS[settings.model](taken_apart(increment, way, turned), settings)
    known = grown(known, *growth)
    unknown = max(0.0, end - max(start, known_until)) + max(0.0, min(end, oldest - settings.clock_jump_s) - start)
    return blind(known, unknown, settings)


def _reading(odometry: OdometryBuffer, time: float) -> tuple[float, float, float, float, float]:
    """Pose at a time, and way and turns from the buffer's first measurement up to then."""
    times, poses, lengths = odometry._times, odometry._poses, odometry._lengths
    right = bisect.bisect_left(times, time)
    if right == 0:
        return (*poses[0].tolist(), *lengths[0])
    x0, y0, a0 = poses[right - 1].tolist()
    way, turned = lengths[right - 1]
    if right == len(times):
        if time <= times[-1]:
            return x0, y0, a0, way, turned
        x1, y1, a1 = _carried_on(odometry, time)
        return x1, y1, a1, way + math.hypot(x1 - x0, y1 - y0), turned + abs(math.remainder(a1 - a0, 2.0 * math.pi))
    x1, y1, a1 = poses[right].tolist()
    fraction = (time - times[right - 1]) / (times[right] - times[right - 1])
    turn = math.remainder(a1 - a0, 2.0 * math.pi)
    step_way, step_turn = lengths[right][0] - way, lengths[right][1] - turned
    return (
        x0 + fraction * (x1 - x0),
        y0 + fraction * (y1 - y0),
        a0 + fraction * turn,
        way + fraction * step_way,
        turned + fraction * step_turn,
    )


def _carried_on(odometry: OdometryBuffer, time: float) -> tuple[float, float, float]:
    """Pose after the newest measurement: as ``odometry`` has it, in numbers."""
    times, (x, y, heading) = odometry._times, odometry._poses[-1].tolist()
    reach = odometry._reach()
    if odometry._extras[-1][0] is not None or reach == 0.0:
        x, y, heading = odometry._pose_at(time).tolist()
        return x, y, heading
    # With the mean speed over as long a time as it is carried on.
    span = max(reach, times[-1] - times[-2])
    x0, y0, heading0, _, _ = _reading(odometry, times[-1] - span)
    turned, share = math.remainder(heading - heading0, 2.0 * math.pi), min(time - times[-1], reach) / span
    # The step as seen from its start, made once more from its end.
    c, s = math.cos(heading - heading0), math.sin(heading - heading0)
    dx, dy = share * (x - x0), share * (y - y0)
    return x + c * dx - s * dy, y + s * dx + c * dy, heading + share * turned

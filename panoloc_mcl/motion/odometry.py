"""A buffer of odometry poses with their own time stamps, and the motion between any two times."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.config.model import MotionSettings
from panoloc_mcl.geometry import angle_difference, between, compose, interpolate, wrap_angle

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """How the robot moved between two times, and how surely that is known.

    Parameters
    ----------
    increment : float64 (3,)
        Pose at the end as seen from the start: metres and radians.
    sd_position, sd_heading : float
        Standard deviations of the noise, metres and radians; both exactly 0 when the robot stood still.
    distance : float
        Length of the way, metres.
    turn : float
        Sum of the turns' magnitudes, radians.
    blind_s : float
        Seconds of the way of which odometry knows nothing.
    """

    increment: Float64
    sd_position: float
    sd_heading: float
    distance: float
    turn: float
    blind_s: float


class OdometryBuffer:
    """Odometry of the last seconds, in order of time whatever order it arrives in.

    Parameters
    ----------
    settings : MotionSettings
    """

    def __init__(self, settings: MotionSettings) -> None:
        self.settings = settings
        self.rejected: dict[str, int] = {}
        self._times: list[float] = []
        self._poses: list[Float64] = []

    def __len__(self) -> int:
        return len(self._times)

    @property
    def oldest(self) -> float:
        """Time of the oldest pose that is kept, seconds; minus infinity when there is none."""
        return self._times[0] if self._times else -math.inf

    def add(self, timestamp: float, pose: Float64) -> bool:
        """Take one pose; a measurement that cannot be used is counted in ``rejected`` and left out.

        Parameters
        ----------
        timestamp : float
            Seconds.
        pose : float64 (3,)
            In the odometry frame.

        Returns
        -------
        bool
            Whether it was taken.
        """
        pose = np.asarray(pose, dtype=np.float64)
        if pose.shape != (3,):
            raise ValueError(f"odometry pose has shape {pose.shape}, needs (3,): x, y, theta")
        if not (math.isfinite(timestamp) and np.isfinite(pose).all()):
            return self._reject("not finite")
        # A copy: callers may fill the same array again and again.
        pose = np.array([pose[0], pose[1], wrap_angle(pose[2])])
        position = bisect.bisect_left(self._times, timestamp)
        if position < len(self._times) and self._times[position] == timestamp:
            return self._reject("duplicated time stamp")
        self._times.insert(position, timestamp)
        self._poses.insert(position, pose)
        oldest = self._times[-1] - self.settings.buffer_s
        # The last pose before the window stays: the window's start lies between it and the next.
        while len(self._times) > 2 and self._times[1] < oldest:
            del self._times[0], self._poses[0]
        return True

    def _reject(self, reason: str) -> bool:
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        return False

    def motion(self, start: float, end: float) -> Motion:
        """The motion between two times, forwards or backwards.

        Where no odometry is known (none at all, or older than ``max_extrapolation_s``), the robot may have gone anywhere its speed
        allows, and the standard deviations say so. Before the first measurement the robot is taken to stand.
        """
        if end < start:
            forward = self.motion(end, start)
            back = between(forward.increment, np.zeros(3))
            return Motion(back, forward.sd_position, forward.sd_heading, forward.distance, forward.turn, forward.blind_s)
        s = self.settings
        known_until = self._times[-1] + s.max_extrapolation_s if self._times else -math.inf
        blind_s = max(0.0, end - max(start, known_until))
        waypoints = self._waypoints(start, end)
        steps = between(waypoints[:-1], waypoints[1:])
        distance = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        turn = float(np.abs(angle_difference(waypoints[1:, 2], waypoints[:-1, 2])).sum())
        # A uniform distribution of half width a has standard deviation a / sqrt(3).
        blind_position = s.image_only_speed_m_s * blind_s / math.sqrt(3.0)
        blind_heading = math.radians(min(s.image_only_turn_rate_deg_s * blind_s, 180.0)) / math.sqrt(3.0)
        return Motion(
            increment=between(waypoints[0], waypoints[-1]),
            sd_position=math.sqrt(
                (s.translation_noise_from_translation * distance) ** 2
                + (s.translation_noise_from_rotation * turn) ** 2
                + blind_position**2
            ),
            sd_heading=math.sqrt(
                (s.rotation_noise_from_rotation * turn) ** 2
                + (s.rotation_noise_from_translation * distance) ** 2
                + blind_heading**2
            ),
            distance=distance,
            turn=turn,
            blind_s=blind_s,
        )

    def _waypoints(self, start: float, end: float) -> Float64:
        if not self._times:
            return np.zeros((2, 3))
        first = bisect.bisect_right(self._times, start)
        last = bisect.bisect_left(self._times, end)
        return np.array([self._pose_at(start), *self._poses[first:last], self._pose_at(end)])

    def _pose_at(self, time: float) -> Float64:
        times, poses = self._times, self._poses
        if time <= times[0]:
            return poses[0]
        if time <= times[-1]:
            right = bisect.bisect_left(times, time)
            fraction = (time - times[right - 1]) / (times[right] - times[right - 1])
            return interpolate(poses[right - 1], poses[right], fraction)
        if len(times) == 1:
            return poses[-1]
        # Carried on with the speed of the last step, but not for longer than allowed, nor for long after a sparse one.
        period = times[-1] - times[-2]
        ahead = min(time - times[-1], self.settings.max_extrapolation_s, period)
        step = between(poses[-2], poses[-1])
        return compose(poses[-1], step * (ahead / period))

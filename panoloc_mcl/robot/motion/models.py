"""Motion models: how odometry is taken apart, and the noise of each part.

The differential and the omnidirectional model are those of Thrun, Burgard & Fox ("Probabilistic Robotics", section 5.4), of nav2's
AMCL and of beluga. Differences: because images come seldom and odometry often, ways and turns that make noise are summed up along
the path and not taken from its two ends, so that driving to and fro is noise as well; driving backwards is a way of negative length
instead of a turn by 180 degrees; and the differential model slips across the way. Where only turns lead aside, that falls with the
square of the way: between images a decimetre apart odometry would be right to a millimetre, and pull what images tell to its side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.settings.localizer import MotionSettings

Float64 = NDArray[np.float64]

# Shorter ways have no direction: noise of the sensors would turn it anywhere (nav2 has the same limit).
_LEAST_WAY_M = 0.01


@dataclass(frozen=True, eq=False)
class Motion:
    """How the robot moved between two times, and how surely that is known.

    Parameters
    ----------
    increment : float64 (3,)
        Pose at the end as seen from the start: metres and radians.
    first_turn, along, across, last_turn : float
        The same, taken apart: a turn into the direction of travel, the way along it and to its left, and a last turn.
    sd_first_turn, sd_along, sd_across, sd_last_turn : float
        Standard deviations of these; all exactly 0 when the robot stood still.
    distance : float
        Length of the way, metres.
    turn : float
        Sum of the turns' magnitudes, radians.
    blind_s : float
        Seconds of the way of which odometry knows nothing.
    duration_s : float
        From the start to the end, seconds; negative when the motion leads back in time.
    """

    increment: Float64
    first_turn: float = 0.0
    along: float = 0.0
    across: float = 0.0
    last_turn: float = 0.0
    sd_first_turn: float = 0.0
    sd_along: float = 0.0
    sd_across: float = 0.0
    sd_last_turn: float = 0.0
    distance: float = 0.0
    turn: float = 0.0
    blind_s: float = 0.0
    duration_s: float = 0.0

    @property
    def sd_heading(self) -> float:
        """Standard deviation of the heading at the end, radians."""
        return math.hypot(self.sd_first_turn, self.sd_last_turn)

    @property
    def stands(self) -> bool:
        """No motion and no noise: nothing changes at all."""
        return not any((*self.increment, self.sd_first_turn, self.sd_along, self.sd_across, self.sd_last_turn))

    def reversed(self) -> Motion:
        """The way back."""
        return replace(
            self,
            increment=between(self.increment, np.zeros(3)),
            first_turn=-self.last_turn,
            along=-self.along,
            across=-self.across,
            last_turn=-self.first_turn,
            sd_first_turn=self.sd_last_turn,
            sd_last_turn=self.sd_first_turn,
            duration_s=-self.duration_s,
        )


def carried(pose: Float64, covariance: Float64, motion: Motion) -> tuple[Float64, Float64]:
    """A pose (3,) after a motion, and its covariance (3, 3) to first order, grown by the noise of each part of the motion."""
    moved = compose(pose, motion.increment)
    dx, dy = moved[:2] - pose[:2]
    direction = pose[2] + motion.first_turn
    way = np.array([math.cos(direction), math.sin(direction)])
    # How an error of the heading at the start carries on: it swings the whole way round.
    swing = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    parts = np.array([[-dy, way[0], -way[1], 0.0], [dx, way[1], way[0], 0.0], [1.0, 0.0, 0.0, 1.0]])
    sds = np.array([motion.sd_first_turn, motion.sd_along, motion.sd_across, motion.sd_last_turn])
    return moved, swing @ covariance @ swing.T + (parts * sds**2) @ parts.T


def taken_apart(increment: Float64, distance: float, turn: float) -> Motion:
    """Turn, drive, turn, without noise; the direction of travel is at most 90 degrees off the heading.

    Parameters
    ----------
    increment : float64 (3,)
    distance, turn : float
        Along the path, metres and radians.
    """
    dx, dy, whole = (float(value) for value in increment)
    way = math.hypot(dx, dy)
    if way < _LEAST_WAY_M:
        return Motion(increment, 0.0, dx, dy, whole, distance=distance, turn=turn)
    bearing = math.atan2(dy, dx)
    if abs(bearing) > 0.5 * math.pi:
        bearing, way = float(wrap_angle(bearing + math.pi)), -way
    return Motion(increment, bearing, way, 0.0, float(wrap_angle(whole - bearing)), distance=distance, turn=turn)


def differential(motion: Motion, s: MotionSettings) -> Motion:
    """Noise of a robot that turns, drives and turns again: what it turned is shared out to the two turns as odometry has them.

    It cannot drive sideways, but slips.
    """
    turns = abs(motion.first_turn) + abs(motion.last_turn)
    first = motion.turn * (abs(motion.first_turn) / turns if turns > 0.0 else 0.5)
    last = motion.turn - first
    from_way = s.rotation_noise_from_translation * motion.distance
    return replace(
        motion,
        sd_first_turn=math.hypot(s.rotation_noise_from_rotation * first, from_way),
        sd_along=math.hypot(
            s.translation_noise_from_translation * motion.distance, s.translation_noise_from_rotation * math.hypot(first, last)
        ),
        sd_across=s.slip_noise_from_translation * motion.distance,
        sd_last_turn=math.hypot(s.rotation_noise_from_rotation * last, from_way),
    )


def omnidirectional(motion: Motion, s: MotionSettings) -> Motion:
    """Noise of a robot that drives any way while it turns: along the way, across it, and of the turn."""
    from_turn = s.translation_noise_from_rotation * motion.turn
    return replace(
        motion,
        sd_along=math.hypot(s.translation_noise_from_translation * motion.distance, from_turn),
        sd_across=math.hypot(s.strafe_noise_from_translation * motion.distance, from_turn),
        sd_last_turn=math.hypot(
            s.rotation_noise_from_rotation * motion.turn, s.rotation_noise_from_translation * motion.distance
        ),
    )


#: By name; `stationary` reads no odometry at all, so that all the time is blind.
NOISE_MODELS: dict[str, Callable[[Motion, MotionSettings], Motion]] = {
    "differential": differential,
    "omnidirectional": omnidirectional,
}


def blind(motion: Motion, seconds: float, s: MotionSettings) -> Motion:
    """The same motion with so many seconds more of which nothing is known: the robot may have gone as far as its speed allows."""
    if seconds <= 0.0:
        return motion
    # A uniform distribution of half width a has standard deviation a / sqrt(3).
    position = s.image_only_speed_m_s * seconds / math.sqrt(3.0)
    heading = math.radians(min(s.image_only_turn_rate_deg_s * seconds, 180.0)) / math.sqrt(3.0)
    return replace(
        motion,
        sd_along=math.hypot(motion.sd_along, position),
        sd_across=math.hypot(motion.sd_across, position),
        sd_last_turn=math.hypot(motion.sd_last_turn, heading),
        blind_s=motion.blind_s + seconds,
    )


def grown(motion: Motion, position_variance: float, heading_variance: float) -> Motion:
    """The same motion with at least so much noise of position (each axis, square metres) and heading (square radians)."""
    if position_variance == heading_variance == 0.0:
        return motion
    position, heading = math.sqrt(position_variance), math.sqrt(heading_variance)
    return replace(
        motion,
        sd_along=max(motion.sd_along, position),
        sd_across=max(motion.sd_across, position),
        sd_last_turn=max(motion.sd_last_turn, heading),
    )

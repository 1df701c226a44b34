"""A buffer of odometry poses with their own time stamps, and the motion between any two times."""

from __future__ import annotations

import bisect
import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference, between, compose, interpolate, inverse, wrap_angle
from panoloc_mcl.robot.locks import Lock, locked
from panoloc_mcl.robot.motion.backward import BEHIND_S, BackwardWatch, Verdict
from panoloc_mcl.robot.motion.measured import along_arc, is_possible, planar_pose, unit_of, usable
from panoloc_mcl.robot.motion.models import NOISE_MODELS, Motion, blind, grown, taken_apart
from panoloc_mcl.robot.settings.localizer import MotionSettings

Float64 = NDArray[np.float64]

# A jump that is rounding or jitter of time stamps is none: steps shorter than this are always possible.
_LEAST_JUMP_M, _LEAST_JUMP_RAD = 0.05, math.radians(5.0)


# Velocity (3,) and covariance (3, 3) that came with a measurement.
Extras = tuple[Float64 | None, Float64 | None]


class OdometryBuffer:
    """Odometry of the last seconds, in order of time whatever order it arrives in; several threads may use it.

    Measurements that cannot be used are left out and counted by reason in ``rejected``; what else befell the stream (a clock that
    jumped, a new origin) is counted in ``events``.

    Parameters
    ----------
    settings : MotionSettings

    Attributes
    ----------
    set_back_s : float
        By how much its clock was set back altogether, seconds: times that were noted before are by so much too late.
    restarts : int
        How often the recording that it comes from began again.
    """

    def __init__(self, settings: MotionSettings) -> None:
        self.settings = settings
        self.rejected: dict[str, int] = {}
        self.events: dict[str, int] = {}
        self.taken = 0
        self.set_back_s, self.restarts = 0.0, 0
        self._backward = BackwardWatch()
        self._lock = Lock()
        self._times: list[float] = []
        self._poses: list[Float64] = []
        # Of each measurement: velocity and covariance if it came with them, and the way and the turns from the first one to it.
        self._extras: list[Extras] = []
        self._lengths: list[tuple[float, float]] = []
        # The last measurement that was left out because it does not fit: if the next one agrees with it, it was right.
        self._suspect: tuple[float, Float64] | None = None
        # From the frame that odometry comes in to that of the buffer; another one once odometry has begun from a new origin.
        self._origin: Float64 | None = None

    def __len__(self) -> int:
        return len(self._times)

    @property
    def oldest(self) -> float:
        """Time of the oldest pose that is kept, seconds; minus infinity when there is none."""
        return self._times[0] if self._times else -math.inf

    @property
    def newest(self) -> float:
        """Time of the newest pose, seconds; minus infinity when there is none."""
        return self._times[-1] if self._times else -math.inf

    @locked
    def add(self, timestamp: float, pose: Float64, velocity: Float64 | None = None, covariance: Float64 | None = None) -> bool:
        """Take one pose; a measurement that cannot be used is counted in ``rejected`` and left out.

        Parameters
        ----------
        timestamp : float
            Seconds.
        pose : float64 (3,)
            In the odometry frame.
        velocity, covariance : float64 (3,) and (3, 3), optional
            As in `Odometry`; left out without a word if they are not finite, as many drivers fill them with anything.

        Returns
        -------
        bool
            Whether it was taken.
        """
        pose = planar_pose(pose, "odometry pose")
        if not (math.isfinite(timestamp) and np.isfinite(pose).all()):
            return self._reject("not finite")
        if unit := unit_of(timestamp):
            return self._reject(f"time stamps look like {unit}, give seconds")
        if not is_possible(pose):
            return self._reject("no robot can be that far off")
        # A copy: callers may fill the same array again and again.
        raw = np.array([pose[0], pose[1], wrap_angle(pose[2])])
        if self._times and not self._clock_fits(timestamp, raw):
            return False
        pose = raw if self._origin is None else compose(self._origin, raw)
        if not self._in_order(timestamp, pose):
            return False
        position = bisect.bisect_left(self._times, timestamp)
        if position < len(self._times) and self._times[position] == timestamp:
            return self._reject("duplicated time stamp")
        if not self._possible(position, timestamp, pose):
            if not self._new_origin(position, timestamp, raw):
                return self._reject("a jump beyond what the robot can do")
            assert self._origin is not None
            pose = compose(self._origin, raw)
        self._suspect = None
        self._times.insert(position, timestamp)
        self._poses.insert(position, pose)
        self._extras.insert(position, (usable(velocity, (3,)), usable(covariance, (3, 3))))
        self._measure(position)
        self.taken += 1
        oldest = self._times[-1] - self.settings.buffer_s
        # The last pose before the window stays: the window's start lies between it and the next.
        while len(self._times) > 2 and self._times[1] < oldest:
            del self._times[0], self._poses[0], self._extras[0], self._lengths[0]
        return True if timestamp >= self._times[0] else self._reject("older than what is kept")

    def _in_order(self, timestamp: float, pose: Float64) -> bool:
        """Whether a measurement can be put in at its time; if the clock was set back, the buffer follows it first."""
        least = 0.0 if self._backward.held else BEHIND_S
        if not self._times or timestamp >= self._times[-1] - least:
            for _ in range(self._backward.came(timestamp, pose)):
                self._reject("behind, and off the way that is known")
            return True
        verdict = self._backward.judge(timestamp, pose, self._pose_at)
        if verdict is Verdict.SUSPECT:
            return False
        if verdict is Verdict.LOOPED:
            repeated, self._backward.repeated = self._backward.repeated[:-1], []
            self.clear()
            self.restarts += 1
            self._happened("the recording began again")
            self._go_on_from(repeated)
        elif verdict is Verdict.SET_BACK:
            held, self._backward.held = self._backward.held[:-1], []
            # One step from the last pose by the old clock to the first by the new one.
            self._set_back(self._times[-1] - held[0][0] + (held[1][0] - held[0][0]))
            self._go_on_from(held)
        return True

    def _go_on_from(self, held: list[tuple[float, Float64]]) -> None:
        """Take what was held back until it was known what it is."""
        for time, pose in held:
            self._times.append(time)
            self._poses.append(pose)
            self._extras.append((None, None))
        self._measure(0)

    def _set_back(self, seconds: float) -> None:
        self._times = [time - seconds for time in self._times]
        self.set_back_s += seconds
        self._happened(f"its clock was set back by {seconds:.1f} s")

    def _happened(self, event: str) -> None:
        self.events[event] = self.events.get(event, 0) + 1

    def _measure(self, position: int) -> None:
        """Sum up ways and turns anew from a measurement on."""
        del self._lengths[position:]
        for index in range(position, len(self._times)):
            if index == 0:
                self._lengths.append((0.0, 0.0))
                continue
            (x0, y0, a0), (x1, y1, a1) = self._poses[index - 1].tolist(), self._poses[index].tolist()
            way, turned = self._lengths[-1]
            turn = abs(math.remainder(a1 - a0, 2.0 * math.pi))
            self._lengths.append((way + math.hypot(x1 - x0, y1 - y0), turned + turn))

    @locked
    def clear(self) -> None:
        """Forget all odometry: it belongs to another clock."""
        self._times, self._poses, self._extras, self._lengths, self._suspect = [], [], [], [], None

    def _clock_fits(self, timestamp: float, raw: Float64) -> bool:
        """Whether a stamp can belong to the stream; after two that agree with each other alone, the clock has jumped."""
        s = self.settings
        if self._times[-1] - max(s.buffer_s, s.clock_jump_s) <= timestamp <= self._times[-1] + s.clock_jump_s:
            return True
        if self._suspect is not None and 0.0 < timestamp - self._suspect[0] <= s.clock_jump_s:
            before = self._suspect
            self.clear()
            self._times, self._poses = [before[0]], [before[1] if self._origin is None else compose(self._origin, before[1])]
            self._extras, self._lengths = [(None, None)], [(0.0, 0.0)]
            self._happened("its clock jumped")
            return True
        self._suspect = (timestamp, raw)
        return self._reject(
            f"time stamp {'ahead' if timestamp > self._times[-1] else 'behind'} by more than the clock can be off"
        )

    def _possible(self, position: int, timestamp: float, pose: Float64) -> bool:
        """Whether the robot can have come from the pose before, and gone on to the one after."""
        neighbours = [index for index in (position - 1, position) if 0 <= index < len(self._times)]
        return all(self._reachable(self._times[index], self._poses[index], timestamp, pose) for index in neighbours)

    def _reachable(self, time: float, pose: Float64, other_time: float, other: Float64) -> bool:
        s, seconds = self.settings, abs(other_time - time)
        if s.max_speed_m_s is not None:
            jump = math.hypot(other[0] - pose[0], other[1] - pose[1])
            if jump > max(s.max_speed_m_s * seconds, _LEAST_JUMP_M):
                return False
        if s.max_turn_rate_deg_s is not None:
            turned = abs(float(angle_difference(other[2], pose[2])))
            return turned <= max(math.radians(s.max_turn_rate_deg_s) * seconds, _LEAST_JUMP_RAD)
        return True

    def _new_origin(self, position: int, timestamp: float, raw: Float64) -> bool:
        """After a jump: whether this newest pose agrees with the one that jumped; then odometry goes on from a new origin."""
        suspect = self._suspect
        if position < len(self._times):
            return False
        self._suspect = (timestamp, raw)
        if suspect is None or not suspect[0] < timestamp or not self._reachable(*suspect, timestamp, raw):
            return False
        # The robot is taken to have stood from the last pose to the first one in the new frame.
        self._origin = compose(self._poses[-1], inverse(suspect[1]))
        self._happened("it began from a new origin")
        return True

    def _reject(self, reason: str) -> bool:
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        return False

    @locked
    def motion(self, start: float, end: float) -> Motion:
        """The motion between two times, forwards or backwards, with the noise of the robot's motion model.

        Where no odometry is known (none at all, or older than can be carried on), the robot may have gone anywhere its speed
        allows, and the standard deviations say so. Shortly before the first measurement the robot is taken to stand; longer before
        it, odometry is of another clock.
        """
        if end < start:
            return self.motion(end, start).reversed()
        s = self.settings
        if s.model == "stationary":
            return replace(blind(Motion(np.zeros(3)), end - start, s), duration_s=end - start)
        known_until = self._times[-1] + self._reach() if self._times else -math.inf
        waypoints = self._waypoints(start, end)
        steps = between(waypoints[:-1], waypoints[1:])
        distance = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        turn = float(np.abs(angle_difference(waypoints[1:, 2], waypoints[:-1, 2])).sum())
        known = NOISE_MODELS[s.model](taken_apart(between(waypoints[0], waypoints[-1]), distance, turn), s)
        known = grown(known, *self._growth(start, end))
        unknown = max(0.0, end - max(start, known_until)) + max(0.0, min(end, self.oldest - s.clock_jump_s) - start)
        return replace(blind(known, unknown, s), duration_s=end - start)

    def _reach(self) -> float:
        """Seconds that odometry is carried on beyond its last pose: not beyond the time that its speed is known for."""
        if self._extras[-1][0] is not None:
            return self.settings.max_extrapolation_s
        return min(self.settings.max_extrapolation_s, self._times[-1] - self._times[0])

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
        reach = self._reach()
        if reach == 0.0:
            return poses[-1]
        velocity = self._extras[-1][0]
        if velocity is not None:
            return compose(poses[-1], along_arc(velocity, min(time - times[-1], reach)))
        # Carried on with the mean speed over as long a time as it may be carried on: a single step is too jittery for that.
        span = max(reach, times[-1] - times[-2])
        step = between(self._pose_at(times[-1] - span), poses[-1])
        return compose(poses[-1], step * (min(time - times[-1], reach) / span))

    def _growth(self, start: float, end: float) -> tuple[float, float]:
        """By how much odometry's own covariance grew: of a position's axis, square metres, and of the heading, square radians."""
        ends = [bisect.bisect_right(self._times, time) - 1 for time in (start, end)]
        if min(ends) < 0:
            return 0.0, 0.0
        before, after = (self._extras[index][1] for index in ends)
        if before is None or after is None or before is after:
            return 0.0, 0.0
        position = 0.5 * float(np.trace(after[:2, :2]) - np.trace(before[:2, :2]))
        return max(position, 0.0), max(float(after[2, 2] - before[2, 2]), 0.0)

    @locked
    def raw_pose_at(self, time: float) -> Float64 | None:
        """Pose (3,) at a time in the frame that odometry comes in now; None without odometry."""
        if not self._times:
            return None
        pose = self._pose_at(time)
        return pose if self._origin is None else compose(inverse(self._origin), pose)

    @locked
    def snapshot(self) -> tuple[dict[str, Float64], dict[str, object]]:
        """All that is remembered: arrays, and a header of plain values."""
        arrays = {"times": np.array(self._times), "poses": np.array(self._poses).reshape(-1, 3)}
        if self._origin is not None:
            arrays["origin"] = self._origin
        if self._suspect is not None:
            arrays["suspect"] = np.array([self._suspect[0], *self._suspect[1]])
        # Not a number where a measurement came without.
        nothing = (np.full(3, np.nan), np.full((3, 3), np.nan))
        for part, name in enumerate(("velocities", "covariances")):
            some = [extras[part] if extras[part] is not None else nothing[part] for extras in self._extras]
            arrays[name] = np.array(some).reshape(-1, *nothing[part].shape)
        clock = {"set_back_s": self.set_back_s, "restarts": self.restarts}
        return arrays, {"rejected": self.rejected, "events": self.events, "taken": self.taken, **clock}

    @locked
    def restore(self, arrays: dict[str, Float64], header: dict[str, Any]) -> None:
        """Take over what `snapshot` gave.

        Raises
        ------
        KeyError, ValueError
            Arrays that are missing or of another shape.
        """
        times, poses = arrays["times"], arrays["poses"]
        if times.ndim != 1 or poses.shape != (len(times), 3) or not np.all(np.diff(times) > 0.0):
            raise ValueError("odometry times and poses do not fit each other")
        extras = arrays["velocities"], arrays["covariances"]
        if extras[0].shape != (len(times), 3) or extras[1].shape != (len(times), 3, 3):
            raise ValueError("odometry velocities and covariances do not fit its times")
        self._times, self._poses = [float(time) for time in times], list(poses)
        self._extras = [(usable(one, (3,)), usable(other, (3, 3))) for one, other in zip(*extras, strict=True)]
        self._measure(0)
        self._origin = arrays.get("origin")
        suspect = arrays.get("suspect")
        self._suspect = None if suspect is None else (float(suspect[0]), suspect[1:])
        self.rejected, self.events, self.taken = dict(header["rejected"]), dict(header["events"]), int(header["taken"])
        self.set_back_s, self.restarts = float(header.get("set_back_s", 0.0)), int(header.get("restarts", 0))

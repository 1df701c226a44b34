"""Which time stamps of images are usable, and when the clock that they come from has jumped."""

from __future__ import annotations

import bisect
import itertools
import math
import statistics
from collections.abc import Mapping
from typing import Any

from panoloc_mcl.robot.motion.measured import unit_of
from panoloc_mcl.robot.motion.odometry import OdometryBuffer
from panoloc_mcl.robot.reasons import Finding, Reason
from panoloc_mcl.robot.settings.localizer import MotionSettings

# Images come so many times their usual distance late at the most, and no farther apart than this, seconds.
_LATE_STEPS, _SPARSEST_S = 2.0, 120.0
# So many images in a row that come more than this late, from a time that none is missing of, are no coincidence, seconds.
_LATE_IN_ROW, _BEHIND_S = 2, 1.0
# Between two images one is missing where they are so many times the usual distance apart.
_GAP_STEPS = 1.5


class ImageClock:
    """The times of the images that were fused, and the time that the belief stands at.

    An image may come late, as long as the way back to its time is known; one that lies far from all others counts only if the next
    one agrees with it: then the clock has jumped, and time goes on from there.

    Parameters
    ----------
    settings : MotionSettings
    odometry : OdometryBuffer
        Of the same robot: it says how far back the way is known, and that time goes on between images.

    Attributes
    ----------
    now : float or None
        Time of the belief, seconds; None before the first image.
    offset_s : float
        Added to stamps of images since their clock was set back and odometry's was not, seconds.
    """

    def __init__(self, settings: MotionSettings, odometry: OdometryBuffer) -> None:
        self._settings, self._odometry = settings, odometry
        self.now: float | None = None
        # As far back as late images are taken.
        self._fused: list[float] = []
        # Time of the newest image: earlier than the belief's where the belief began anew at a time that no image had reached.
        self._newest = -math.inf
        # Time stamp of the last image that was left out because it is so far from the others.
        self._suspect: float | None = None
        # The next image follows on a pause of unknown length.
        self._paused = False
        # What is known of odometry's clock: it went back by so much, and its recording began again so often.
        self._set_back_s, self._restarts = odometry.set_back_s, odometry.restarts
        # The last time between two images, seconds: without odometry it says when the next one is due.
        self._step = 0.0
        self.offset_s = 0.0
        # Stamps of images in a row that came late, each later than the one before, and odometry's newest time at the first of them.
        self._late: list[float] = []
        self._late_since = -math.inf

    def start_at(self, timestamp: float | None) -> None:
        """The belief begins anew at a time, seconds; None if that is not known."""
        self.now, self._fused, self._suspect, self._paused = timestamp, [], None, False

    def pause(self) -> None:
        """The program was stopped: the next image counts whatever its stamp; if that is not a little later, the clock jumped."""
        self._paused, self._fused, self._suspect = self.now is not None, [], None

    def follow_odometry(self) -> float:
        """Go back with odometry's clock if it was set back; returns by how much, seconds. Begin anew if its recording did."""
        back, self._set_back_s = self.owed_s, self._odometry.set_back_s
        if back and self.now is not None:
            self.now, self._fused = self.now - back, [time - back for time in self._fused]
            self._newest -= back
            self.offset_s = self.offset_s - back if self.offset_s > _BEHIND_S else 0.0
        if self._restarts != self._odometry.restarts:
            self._restarts = self._odometry.restarts
            self.pause()
        return back

    @property
    def owed_s(self) -> float:
        """By how much odometry's clock was set back that this one did not follow yet, seconds."""
        return self._odometry.set_back_s - self._set_back_s

    def set_back(self, timestamp: float) -> Finding:
        """Whether the clock of the images was set back: several in a row come late, and no gap was left where they belong.

        With odometry the stamps are brought to its clock, which went on, by adding `offset_s`; without, time goes on from here.
        """
        if self.now is None or self._paused or not math.isfinite(timestamp) or timestamp >= self._newest - _BEHIND_S:
            self._late = []
            return Finding()
        follows = bool(self._late) and 0.0 < timestamp - self._late[-1] <= self._settings.clock_jump_s
        self._late = [*self._late, timestamp] if follows else [timestamp]
        self._late_since = self._late_since if follows else self._odometry.newest
        jumped = timestamp < self.now - self._settings.buffer_s
        if jumped or (timestamp < self._late_from() and self._odometry.newest < self.now):
            # Another clock altogether, or odometry's has jumped, too.
            return Finding()
        if self._was_missing(timestamp):
            self._late = []
        # The very stamps that there were may be images that were sent again.
        again = timestamp in self._fused
        if len(self._late) < _LATE_IN_ROW + again or (again and self._came_at_once()):
            return Finding()
        # The first of them was taken one step after the last that was not late.
        by = self._newest - self._late[0] + (self._late[-1] - self._late[-2])
        went = by if len(self._odometry) else 0.0
        # Those before this one were of the new time, too.
        self._late, self._fused = [], [time + went for time in self._late[:-1]]
        if went:
            self.offset_s += by
            told = f"image stamps were set back by {by:.1f} s and odometry's were not; so much is added to them"
        else:
            self.now = self._newest = timestamp - 1e-6
            told = f"image stamps were set back by {by:.1f} s; going on from there"
        return Finding(told, Reason.CLOCK_SET_BACK)

    def _came_at_once(self) -> bool:
        """Whether late images came faster than they were taken, as those do that are sent again: time by odometry hardly went on."""
        went_on = self._odometry.newest - self._late_since
        return len(self._odometry) > 0 and went_on < 0.5 * (self._late[-1] - self._late[0])

    def _was_missing(self, timestamp: float) -> bool:
        """Whether there is a gap where a late image was taken, so that it was only held up."""
        index = bisect.bisect(self._fused, timestamp)
        if not 0 < index < len(self._fused):
            return False
        usual = statistics.median(after - before for before, after in itertools.pairwise(self._fused))
        return self._fused[index] - self._fused[index - 1] > _GAP_STEPS * usual

    def problem(self, timestamp: float) -> Finding:
        """Why the time stamp of an image cannot be used; empty when it can."""
        if not math.isfinite(timestamp):
            return Finding("image skipped: its time stamp is not finite", Reason.STAMP_INVALID)
        if unit := unit_of(timestamp):
            return Finding(f"image skipped: time stamp {timestamp:g} looks like {unit}; give seconds", Reason.STAMP_UNIT)
        if self.now is None or self._paused:
            return Finding()
        if timestamp in self._fused:
            return Finding(f"image skipped: time stamp {timestamp:.9f} came twice{_coarse(timestamp)}", Reason.STAMP_TWICE)
        if self._late_from() <= timestamp <= self._ahead_to() or self._agrees(timestamp):
            return Finding()
        self._suspect = timestamp
        if timestamp < self.now:
            late = f"{self.now - timestamp:.3f} s late, before the odometry that is kept"
            return Finding(f"image skipped: {late}", Reason.STAMP_LATE)
        ahead = f"{timestamp - self.now:.3f} s ahead{_coarse(timestamp)}"
        return Finding(f"image skipped: its time stamp is {ahead}; used only if the next one agrees", Reason.STAMP_AHEAD)

    def follow(self, timestamp: float) -> float | None:
        """Seconds that the clock has jumped by, if an image of which there is no `problem` shows that it has; time goes on there."""
        if self._paused:
            self._paused = False
            assert self.now is not None
            if not self.now < timestamp <= self._ahead_to():
                self._suspect = timestamp
                return self._jumped(timestamp)
        if self.now is None or self._late_from() <= timestamp <= self._ahead_to():
            self._suspect = None
            return None
        if self._is_sparse(timestamp):
            # No jump: images are far between, and what happened between them is as unknown as their distance in time says.
            self._suspect = None
            return None
        return self._jumped(timestamp)

    def _jumped(self, timestamp: float) -> float:
        assert self._suspect is not None
        assert self.now is not None
        jump, slack = self._suspect - self.now, self._settings.clock_jump_s
        if self._odometry.newest > timestamp + slack or self._odometry.newest < self._suspect - slack:
            # Odometry by the old clock would only mislead.
            self._odometry.clear()
        self.now, self._fused, self._suspect = self._suspect, [], None
        self._newest = self.now
        return jump

    def is_late(self, timestamp: float) -> bool:
        """Whether an image was taken before the time that the belief stands at."""
        return self.now is not None and timestamp < self.now

    def fuse(self, timestamp: float) -> None:
        """An image was taken into the belief, which stands at its time unless it was late."""
        if not self.is_late(timestamp):
            self._step = 0.0 if self.now is None else timestamp - self.now
            self.now = timestamp
        self._newest = max(self._newest, timestamp)
        bisect.insort(self._fused, timestamp)
        while self._fused and self._fused[0] < self._late_from():
            self._fused.pop(0)

    def _late_from(self) -> float:
        """The earliest time that a late image may have: the way back to it must be known."""
        assert self.now is not None
        kept = self.now - self._settings.buffer_s
        # Odometry that begins after the belief's time is of another clock, or too late to say anything.
        return max(self._odometry.oldest, kept) if self._odometry.oldest <= self.now else kept

    def _ahead_to(self) -> float:
        """The latest time that an image can have if the clock has not jumped."""
        assert self.now is not None
        return max(self._odometry.newest + self._settings.clock_jump_s, self.now + self._usual_gap)

    @property
    def _usual_gap(self) -> float:
        """How long after an image the next one may come without odometry in between, seconds."""
        return max(self._settings.clock_jump_s, _LATE_STEPS * self._step)

    def _agrees(self, timestamp: float) -> bool:
        """Whether an image that lies far from all others follows on the one before it, which did, too."""
        if self._suspect is None or self.now is None:
            return False
        return 0.0 < timestamp - self._suspect <= self._settings.clock_jump_s or self._is_sparse(timestamp)

    def _is_sparse(self, timestamp: float) -> bool:
        """Without odometry: whether three images in a row came about as far apart, so that this is how often they come."""
        if self._suspect is None or self.now is None or len(self._odometry):
            return False
        first, second = self._suspect - self.now, timestamp - self._suspect
        return 0.0 < first < _SPARSEST_S and max(first, second) <= _LATE_STEPS * min(first, second)

    def snapshot(self) -> dict[str, Any]:
        """All that is remembered, as plain values."""
        return {
            "now": self.now,
            "fused": self._fused,
            "newest": self._newest if math.isfinite(self._newest) else None,
            "suspect": self._suspect,
            "paused": self._paused,
            "step": self._step,
            "offset_s": self.offset_s,
            "late": self._late,
            "late_since": self._late_since if math.isfinite(self._late_since) else None,
            "set_back_s": self._set_back_s,
            "restarts": self._restarts,
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave; KeyError or TypeError, and nothing changed, if that does not fit."""
        now, suspect = (None if values[name] is None else float(values[name]) for name in ("now", "suspect"))
        self._fused, self._paused = [float(time) for time in values["fused"]], bool(values["paused"])
        self._step, self.offset_s = float(values.get("step", 0.0)), float(values.get("offset_s", 0.0))
        self._late = [float(time) for time in values.get("late", ())]
        self._late_since = -math.inf if values.get("late_since") is None else float(values["late_since"])
        # What odometry's clock did after the last image is still to be followed; older states do not say what was.
        self._set_back_s = float(values.get("set_back_s", self._odometry.set_back_s))
        self._restarts = int(values.get("restarts", self._odometry.restarts))
        newest = values.get("newest", now)
        self._newest = -math.inf if newest is None else float(newest)
        self.now, self._suspect = now, suspect


def _coarse(timestamp: float) -> str:
    """Says of a stamp since 1970 that it went through single precision, which knows such times to two minutes."""
    return " (stamps of single precision: keep them in doubles)" if timestamp > 1e8 and timestamp % 128.0 == 0.0 else ""

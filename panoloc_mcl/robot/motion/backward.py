"""Odometry that comes with stamps from before the newest: late, or by a clock that was set back, or a recording that began again.

Poses tell. What comes late lies on the way that is known already, at its time; what a clock that was set back stamps goes on from the
pose that came last. A recording that begins again says the same as before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference

Float64 = NDArray[np.float64]

# Stamps this far behind are not mere jitter, seconds; those of a stream follow on each other within as much.
BEHIND_S, _GAP_S = 1.0, 1.0
# So far from the known way (metres and half radians) a pose does not lie on it.
_OFF_M = 0.03
_AGREEING, _REPEATED = 3, 5
# A stream that does not come in the order of time says nothing of its clock: so many must have.
_IN_ORDER = 5
# A pose is the same if it differs by rounding only.
_SAME = 1e-9


class Verdict(Enum):
    """What a measurement behind the newest is."""

    LATE = auto()
    SUSPECT = auto()
    SET_BACK = auto()
    LOOPED = auto()


class BackwardWatch:
    """Judges measurements by those that came just before them, whatever their stamps."""

    def __init__(self) -> None:
        # That came last and were held back, as they do not lie on the known way.
        self.held: list[tuple[float, Float64]] = []
        self._last: tuple[float, Float64] | None = None
        # That came last and say the same as before.
        self.repeated: list[tuple[float, Float64]] = []
        # So many came in the order of time since the last that did not, and before it.
        self._in_row = self._before = 0

    def came(self, timestamp: float, pose: Float64) -> int:
        """A measurement that is not behind; returns how many were held back and turn out to have been wrong."""
        dropped, self.held, self.repeated = len(self.held), [], []
        self._follows(timestamp, pose)
        return dropped

    def _follows(self, timestamp: float, pose: Float64) -> bool:
        """Whether a measurement follows in time on the one that came before; counts how many in a row did."""
        follows = self._last is not None and 0.0 < timestamp - self._last[0] <= _GAP_S
        self._in_row, self._before = (self._in_row + 1, self._before) if follows else (1, self._in_row)
        self._last = (timestamp, pose)
        return follows

    def judge(self, timestamp: float, pose: Float64, known: Callable[[float], Float64]) -> Verdict:
        """What a measurement behind the newest is; ``known`` is the way so far."""
        before = self._last
        follows = self._follows(timestamp, pose)
        if self.held and not follows:
            self.held = []
        off = _apart(pose, known(timestamp))
        repeats = off < _SAME and (follows or not self.repeated)
        self.repeated = [*self.repeated, (timestamp, pose)] if repeats else []
        if len(self.repeated) >= _REPEATED and before is not None and _apart(pose, before[1]) > _SAME:
            return Verdict.LOOPED
        in_order = max(self._in_row, self._before) > _IN_ORDER
        goes_on = before is not None and in_order and off > _OFF_M and _apart(pose, before[1]) < 0.5 * off
        if not goes_on and not (self.held and follows):
            return Verdict.LATE
        self.held.append((timestamp, pose))
        return Verdict.SET_BACK if len(self.held) >= _AGREEING else Verdict.SUSPECT


def _apart(one: Float64, other: Float64) -> float:
    turned = abs(float(angle_difference(one[2], other[2])))
    return math.hypot(one[0] - other[0], one[1] - other[1]) + 0.5 * turned

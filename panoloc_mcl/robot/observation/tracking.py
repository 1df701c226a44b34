"""Tracking does not search: where a robot is expected, an image is compared there, and elsewhere only if it does not fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.observation.field import VoteField

# What refinement reaches from an expected pose: by all its coarse steps, and by those that reach no farther than the last ones need.
_NARROW_M, _NARROW_DEG = 0.1, 4.0
_NEAR_M, _NEAR_DEG = 0.1, 2.0
# Votes at the expected pose fall short of the best ones by this many tolerances at most: those of the true pose nearly always do.
_SHORT = 2.0
# A measured pose is the expected one, but for this many of the belief's standard deviations and the reach of a step.
_SPREADS, _REACH_M, _REACH_RAD = 4.0, 0.05, np.radians(1.0)


@dataclass(frozen=True, eq=False)
class Expected:
    """Where a belief that is sure leads an image to be taken.

    Parameters
    ----------
    pose : float64 (3,)
        Metres, radians.
    spread_m, spread_rad : float
        Standard deviations.
    everywhere : bool
        The image is compared with the whole map, even where it fits the pose.
    """

    pose: NDArray[np.float64]
    spread_m: float
    spread_rad: float
    everywhere: bool = False

    @classmethod
    def of(cls, pose: NDArray[np.float64], spread_m: float, spread_deg: float, everywhere: bool = False) -> Self | None:
        """None where the belief is too wide to begin there."""
        if spread_m >= _NARROW_M or spread_deg >= _NARROW_DEG:
            return None
        return cls(pose, spread_m, math.radians(spread_deg), everywhere)

    @property
    def near(self) -> bool:
        """Whether it is so sure that a refinement need not reach far."""
        return self.spread_m < _NEAR_M and self.spread_rad < math.radians(_NEAR_DEG)

    def fits(self, field: VoteField) -> bool:
        """Whether the votes of an image, all over the map, do not point elsewhere."""
        there = np.array([*field.places.positions[field.peak.place], field.peak.heading])
        near = np.hypot(*(there - self.pose)[:2]) <= 2.0 * field.places.spacing + _SPREADS * self.spread_m
        turns = np.zeros(1) if self.near else self.spread_rad * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
        votes = max(field.votes_at(self.pose + np.array([0.0, 0.0, turn])) for turn in turns)
        return bool(near) and votes >= field.peak.votes - _SHORT * field.tolerance

    def holds(self, pose: NDArray[np.float64]) -> bool:
        """Whether a measured pose (3,) is where it was expected."""
        turned = abs((pose[2] - self.pose[2] + np.pi) % (2.0 * np.pi) - np.pi)
        far = float(np.hypot(*(pose - self.pose)[:2]))
        return bool(far <= _SPREADS * self.spread_m + _REACH_M and turned <= _SPREADS * self.spread_rad + _REACH_RAD)


@runtime_checkable
class TrackingModel(Protocol):
    """An observation model that may begin where the robot is expected."""

    def observe_near(self, panorama: Panorama, expected: Expected) -> VoteField:
        """Votes of one image over all headings, its pose measured from the expected one; as `observe` where that does not fit."""

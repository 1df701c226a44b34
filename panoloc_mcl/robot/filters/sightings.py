"""Which images counted: a belief that nothing has confirmed for long is no longer sure, however narrow it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.estimate import Status
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.reasons import Finding, Reason
from panoloc_mcl.robot.settings.localizer import StatusSettings

# References within this share of their extent from one line are on it; so few of them, or so close together, span no map, metres.
_LINE_SHARE, _FEWEST, _PATCH_M = 0.1, 3, 0.5
_LEAST_WAY_M, _MOST_WAY_M = 1.0, 3.0
# Odds are never quite 0.
_LEAST = 1e-9


def telling_way(references: NDArray[np.float64]) -> float:
    """How far a robot must drive before a map can tell its pose, metres; 0 where every image can.

    Two references, a line of them or a patch show a place from one side only: depth across the line is not known from it, and poses
    to its left look like poses to its right.

    Parameters
    ----------
    references : float64 (n, 2)
        Positions, metres.
    """
    distinct = np.unique(np.round(references, 2), axis=0)
    centred = distinct - distinct.mean(axis=0)
    along, across = (np.linalg.svd(centred, compute_uv=False) if len(distinct) > 1 else np.zeros(2)).tolist()[:2]
    root = math.sqrt(len(distinct))
    if len(distinct) >= _FEWEST and across > _LINE_SHARE * along and along / root > _PATCH_M / 2.0:
        return 0.0
    return float(np.clip(2.0 * along / root, _LEAST_WAY_M, _MOST_WAY_M))


class Sightings:
    """How long ago an image spoke for the pose, and why those since did not.

    An image speaks for the pose if it is sure of itself and says what is believed, or if it is far better explained by where odometry
    led than by anywhere on the map; then several doubtful ones together may, too. Of a robot that was carried off, images are explained
    no better there than elsewhere on the mean, so that odds of a hundred to one come about by luck for one robot in a hundred at the
    most, however many images it sees (Ville 1939). Once no image has spoken for the pose for too long, only one that is sure of itself
    does: many doubtful ones may err alike.

    Parameters
    ----------
    limits : StatusSettings
    telling_way_m : float
        So far the robot must drive, from one image that is sure of the pose to another, before a pose that the map alone cannot tell
        from its twins is known (see `telling_way`).
    """

    def __init__(self, limits: StatusSettings, telling_way_m: float = 0.0) -> None:
        self._limits = limits
        # Driven since an image was sure of the pose, NaN before any; and how far that was when the last one was.
        self._telling_way_m, self._way_m, self._told_m = telling_way_m, math.nan, 0.0
        # Images that were left out since one was taken in; and all since one spoke for the pose, with the odds that they gave it.
        self._left_out = self._silent = 0
        self._log_odds = 0.0
        self._last: Reason | None = None
        # Whether the pose was known when an image was last taken in.
        self._sure = False

    def counted(self, way_m: float = 0.0, backing: float = math.nan, vouches: bool = True) -> None:
        """An image was taken into the belief.

        Parameters
        ----------
        way_m : float
            Since the one before, metres.
        backing, vouches : float, bool
            As in `FilterState`.
        """
        self._left_out, self._last = 0, None
        if vouches:
            self._way_m = self._told_m = 0.0 if math.isnan(self._way_m) else self._way_m + way_m
        else:
            self._way_m += way_m
        if not math.isnan(backing):
            self._log_odds += math.log(max(backing, _LEAST))
        doubted = self._silent >= self._limits.stale_images
        if vouches or (not doubted and self._log_odds >= math.log(self._limits.counted_odds)):
            self._silent, self._log_odds = 0, 0.0
        else:
            self._silent += 1

    def left_out(self, why: Reason | None) -> None:
        """An image was not."""
        self._left_out, self._silent, self._last = self._left_out + 1, self._silent + 1, why

    def judge(self, status: Status, since: Motion | None) -> tuple[Status, Finding]:
        """The status that the filter's own one amounts to, and why it is another.

        Parameters
        ----------
        status : Status
            What the filter thinks of its belief.
        since : Motion or None
            Where odometry has led from the time that the belief stands at; None where the belief stands at the newest image.
        """
        if status is not Status.CONVERGED and not self._left_out:
            self._way_m, self._told_m = math.nan, 0.0
        if status is Status.CONVERGED and self._told_m < self._telling_way_m:
            told = f"the map cannot tell this pose from others ({self._told_m:.1f} of {self._telling_way_m:.1f} m driven)"
            return Status.AMBIGUOUS, Finding(f"{told}; {Reason.MAP_CANNOT_TELL.remedy}", Reason.MAP_CANNOT_TELL)
        if not self._left_out:
            self._sure = status is Status.CONVERGED
        if status is Status.CONVERGED:
            if self._left_out and since is not None and self._leads_away(since):
                gone = f"{since.distance:.1f} m and {math.degrees(since.turn):.0f} degrees"
                return Status.STALE, Finding(
                    f"odometry has gone {gone} since an image counted{self._why}", Reason.POSE_OUTDATED
                )
            if self._silent >= self._limits.stale_images:
                return Status.STALE, Finding(
                    f"none of the last {self._silent} images counted{self._why}", Reason.NOTHING_COUNTED
                )
        elif self._left_out and self._sure and status in (Status.SEARCHING, Status.LOST):
            return Status.STALE, Finding(
                f"odometry alone no longer tells the pose, {self._left_out} images did not count{self._why}",
                Reason.NOTHING_COUNTED,
            )
        return status, Finding()

    @property
    def _why(self) -> str:
        return "" if self._last is None else f" ({self._last.value}: {self._last.remedy})"

    def _leads_away(self, since: Motion) -> bool:
        """Farther than a belief that is sure may be wide."""
        spread = math.hypot(since.sd_along, since.sd_across)
        return (
            since.distance + spread > self._limits.converged_spread_m
            or math.degrees(since.turn + since.sd_heading) > self._limits.converged_spread_deg
        )

    def snapshot(self) -> dict[str, Any]:
        """All that is remembered, as plain values."""
        way = {"way_m": self._way_m, "told_m": self._told_m, "telling_way_m": self._telling_way_m}
        silent = {"silent": self._silent, "log_odds": self._log_odds}
        return {"left_out": self._left_out, "last": self._last, "sure": self._sure, **silent, **way}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave; KeyError or ValueError, and nothing changed, if that does not fit."""
        last = None if values["last"] is None else Reason(values["last"])
        left_out, sure = int(values["left_out"]), bool(values["sure"])
        self._way_m, self._telling_way_m = float(values.get("way_m", math.nan)), float(values.get("telling_way_m", 0.0))
        self._told_m = float(values.get("told_m", 0.0 if math.isnan(self._way_m) else self._way_m))
        self._silent, self._log_odds = int(values.get("silent", left_out)), float(values.get("log_odds", 0.0))
        self._left_out, self._last, self._sure = left_out, last, sure

"""Which images counted: a belief that nothing has confirmed for long is no longer sure, however narrow it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from panoloc_mcl.robot.filters.estimate import Status
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.reasons import Finding, Reason
from panoloc_mcl.robot.settings.localizer import StatusSettings


class Sightings:
    """How long ago an image counted, and why those since did not.

    Parameters
    ----------
    limits : StatusSettings
    """

    def __init__(self, limits: StatusSettings) -> None:
        self._limits = limits
        self._left_out = 0
        self._last: Reason | None = None
        # Whether the pose was known when an image last counted.
        self._sure = False

    def counted(self) -> None:
        """An image was taken into the belief."""
        self._left_out, self._last = 0, None

    def left_out(self, why: Reason | None) -> None:
        """An image was not."""
        self._left_out, self._last = self._left_out + 1, why

    def judge(self, status: Status, since: Motion | None) -> tuple[Status, Finding]:
        """The status that the filter's own one amounts to, and why it is another.

        Parameters
        ----------
        status : Status
            What the filter thinks of its belief.
        since : Motion or None
            Where odometry has led from the time that the belief stands at; None where the belief stands at the newest image.
        """
        if not self._left_out:
            self._sure = status is Status.CONVERGED
            return status, Finding()
        if status is Status.CONVERGED:
            if since is not None and self._leads_away(since):
                gone = f"{since.distance:.1f} m and {math.degrees(since.turn):.0f} degrees"
                return Status.STALE, Finding(
                    f"odometry has gone {gone} since an image counted{self._why}", Reason.POSE_OUTDATED
                )
            if self._left_out >= self._limits.stale_images:
                return Status.STALE, Finding(
                    f"none of the last {self._left_out} images counted{self._why}", Reason.NOTHING_COUNTED
                )
        elif self._sure and status in (Status.SEARCHING, Status.LOST):
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
        return {"left_out": self._left_out, "last": self._last, "sure": self._sure}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave; KeyError or ValueError, and nothing changed, if that does not fit."""
        last = None if values["last"] is None else Reason(values["last"])
        left_out, sure = int(values["left_out"]), bool(values["sure"])
        self._left_out, self._last, self._sure = left_out, last, sure

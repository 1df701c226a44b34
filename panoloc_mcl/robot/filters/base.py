"""The one interface of the filters, and what they may know at the start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.estimate import FilterState
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.field import VoteField

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """What is known at the start; None = nothing.

    Parameters
    ----------
    position : (float, float) or None
        Metres, map frame.
    heading : float or None
        Radians.
    sd_position : float
        Standard deviation of x and of y, metres.
    sd_heading : float
        Radians.
    covariance : float64 (3, 3), optional
        Of position and heading together, instead of the two standard deviations.
    """

    position: tuple[float, float] | None = None
    heading: float | None = None
    sd_position: float = 0.2
    sd_heading: float = math.radians(5.0)
    covariance: Float64 | None = None

    @classmethod
    def around(cls, pose: Float64, covariance: Float64) -> Self:
        """A pose (3,) with its covariance (3, 3)."""
        x, y, heading = (float(value) for value in pose)
        sd_position = math.sqrt(0.5 * float(covariance[0, 0] + covariance[1, 1]))
        return cls((x, y), heading, sd_position, math.sqrt(float(covariance[2, 2])), covariance)


class PoseFilter(Protocol):
    """A belief about the pose that odometry moves and vote fields sharpen."""

    def propagate(self, motion: Motion) -> None:
        """Move the belief by odometry."""

    def heading_hypotheses(self, offset: Motion | None) -> Float64 | None:
        """Headings that the next image should be voted at, radians; None = all around the circle.

        ``offset`` is the motion from the belief's time to the image's when the image is late.
        """

    def update(self, votes: VoteField, offset: Motion | None) -> None:
        """Take in what an image says; ``offset`` as above."""

    def state(self) -> FilterState:
        """The belief now."""

    def particles(self) -> tuple[Float64, Float64]:
        """Poses (n, 3) and weights (n,) that the belief is made of; n = 0 for a filter without particles. Only to be looked at."""

    def snapshot(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """All that the next step depends on, its random numbers included: arrays, and a header of plain values."""

    def restore(self, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave; KeyError or ValueError, and nothing changed, if that does not fit."""

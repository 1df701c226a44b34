"""Where a robot changes from one map to another: lifts, ramps and doors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Transition:
    """A way from one map to another, in both directions.

    Parameters
    ----------
    between : (str, str)
        Names of the maps.
    at : ((float, float), (float, float))
        Where its ends are, metres, each in the frame of its map.
    radius_m : float
        A robot so near to an end may be on the other map when the next image comes.
    """

    between: tuple[str, str]
    at: tuple[tuple[float, float], tuple[float, float]]
    radius_m: float = 1.5

    def leads_to(self, name: str, pose: NDArray[np.float64]) -> str | None:
        """The map that a robot at a pose of a map may change to; None if it is not near an end."""
        for here, there in ((0, 1), (1, 0)):
            x, y = self.at[here]
            if self.between[here] == name and math.hypot(pose[0] - x, pose[1] - y) <= self.radius_m:
                return self.between[there]
        return None

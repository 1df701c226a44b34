"""What a pose errs by because the views that it was read off err: a function of where their sources lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

# Power of the variance that the mean of independent sources has: 1 if they averaged out, 0 if a single one counted. Set on the rendered
# hall with references that are 2 and 5 cm off.
_AVERAGING = 0.25


def shares(weights: Float64, offsets: Float64) -> Float64:
    """How much of each kind of error a pose has that is read off views of several sources.

    Parameters
    ----------
    weights : float64 (s,)
        Of the sources, with sum 1.
    offsets : float64 (s, 2)
        From the sources to the pose, metres.

    Returns
    -------
    float64 (3,)
        Of the variance of a source's own pose: between that of one source and of the mean of independent ones, because an image locks
        on to one of several that contradict each other. Of what grows to one side: the squared mean offset. Of what grows with the
        distance: the mean of independent errors that grow with its square.
    """
    weighted = weights * weights
    mean = weights @ offsets
    squares = np.sum(offsets * offsets, axis=1)
    return np.array([weighted.sum() ** _AVERAGING, mean @ mean, weighted @ (squares * squares)])


@dataclass(frozen=True, eq=False)
class SourceErrors:
    """Standard deviations of the errors that views have from their sources; of x and y (each) and of the heading.

    Parameters
    ----------
    of_pose : float64 (2,)
        Of a reference's own pose, metres and radians.
    to_one_side : float64 (2,)
        For every metre that the sources lie off the pose in the mean, metres and radians a metre.
    with_distance : float64 (2,)
        Of a single source, for the square of its distance, metres and radians a square metre.
    trials : int
        How many they were learnt from; 0: they are a guess.
    """

    of_pose: Float64
    to_one_side: Float64
    with_distance: Float64
    trials: int

    def covariance(self, weights: Float64, offsets: Float64) -> Float64:
        """Of a pose read off views of sources (see `shares`): float64 (3, 3), metres and radians."""
        x, heading = shares(weights, offsets) @ np.square([self.of_pose, self.to_one_side, self.with_distance])
        return np.diag([x, x, heading])

    def array(self) -> Float64:
        """All of it, float64 (7,), for a map file."""
        return np.concatenate([self.of_pose, self.to_one_side, self.with_distance, [self.trials]])

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know: that nothing could be learnt."""
        if self.trials:
            return ()
        return (
            "how far the map errs is not known, as too few references have neighbours to compare: poses are taken to be off by "
            f"{100.0 * self.of_pose[0]:.0f} cm and {np.degrees(self.of_pose[1]):.1f} degrees",
        )

    @classmethod
    def of_array(cls, values: NDArray[Any] | None) -> Self:
        """What `array` gave; a guess where there is nothing, or these are no standard deviations."""
        values = np.zeros(0) if values is None else np.asarray(values, dtype=np.float64)
        if values.shape != (7,) or not (np.isfinite(values).all() and (values >= 0.0).all()):
            return cls(UNKNOWN.of_pose, UNKNOWN.to_one_side, UNKNOWN.with_distance, 0)
        return cls(values[0:2], values[2:4], values[4:6], int(values[6]))


#: Where nothing can be learnt: 2 cm and 0.5 degrees, as of references that were surveyed with a tape.
UNKNOWN = SourceErrors(np.array([0.02, np.radians(0.5)]), np.zeros(2), np.zeros(2), 0)
#: References that err by nothing.
NONE = SourceErrors(np.zeros(2), np.zeros(2), np.zeros(2), 0)

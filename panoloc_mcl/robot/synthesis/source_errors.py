"""What a pose errs by because the views that it was read off err: what the image shows of it, and where their sources lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.measurement import growth

Float64 = NDArray[np.float64]


def sharpness_of(displaced: float) -> float:
    """To what power weights of sources count, see `shares`: 1 where their errors average out, large where one of them is locked on to.

    Where the views of all sources lie within the reach of a feature, about a pixel, of each other, the image settles between them;
    where they do not, it locks on to one, the heavier the likelier, as a blend of several would agree less.

    Parameters
    ----------
    displaced : float
        By how many pixels the errors of its pose displace the view of a source, standard deviation.
    """
    # The difference of two sources has twice the variance.
    return 1.0 + 2.0 * displaced * displaced


def shares(weights: Float64, offsets: Float64, sharpness: float) -> Float64:
    """How much of each kind of error a pose has that is read off views of several sources.

    Parameters
    ----------
    weights : float64 (s,)
        Of the sources, with sum 1.
    offsets : float64 (s, 2)
        From the sources to the pose, metres.
    sharpness : float
        See `sharpness_of`.

    Returns
    -------
    float64 (2,)
        Of the variance of a source's own pose, and of what grows to one side: the squared mean offset, square metres.
    """
    sharp = (weights / weights.max()) ** sharpness
    sharp /= sharp.sum()
    mean = sharp @ offsets
    return np.array([sharp @ sharp, mean @ mean])


@dataclass(frozen=True, eq=False)
class SourceErrors:
    """Errors that views have from their sources; of x and y (each) and of the heading.

    Parameters
    ----------
    of_views : float64 (2,)
        Factors on the covariance that the image shows (see `Equations.covariance`).
    of_pose : float64 (2,)
        Standard deviation of a reference's own pose, metres and radians.
    to_one_side : float64 (2,)
        For every metre that the sources lie off the pose in the mean, metres and radians a metre.
    sharpness : float
        See `sharpness_of`.
    trials : int
        How many they were learnt from; 0: they are a guess.
    usual_contradiction : float
        How far bands of rows contradict each other where the camera is as it is described; infinite where that is not known.
    """

    of_views: Float64
    of_pose: Float64
    to_one_side: Float64
    sharpness: float
    trials: int
    usual_contradiction: float = math.inf

    def excess(self, contradiction: float) -> float:
        """How far a contradiction of bands of rows (see `Equations.contradiction`) is beyond the usual one; 0 if it is not."""
        return max(0.0, contradiction - self.usual_contradiction)

    def of_image(self, shown: Float64, excess: float = 0.0) -> Float64:
        """Covariance of a pose for what the image shows, float64 (3, 3), from that which it shows but for a factor.

        Parameters
        ----------
        shown : float64 (3, 3)
        excess : float
            Of the contradiction between bands of rows: it tells of an error that nothing else shows.
        """
        x, heading = np.sqrt(growth(excess) * self.of_views)
        factors = np.array([x, x, heading])
        return np.asarray(factors[:, None] * shown * factors)

    def of_sources(self, weights: Float64, offsets: Float64) -> Float64:
        """Covariance of a pose for the sources that it was read off: float64 (3, 3), metres and radians.

        Parameters
        ----------
        weights : float64 (s,)
            Of the sources, with sum 1.
        offsets : float64 (s, 2)
            From the sources to the pose, metres.
        """
        x, heading = shares(weights, offsets, self.sharpness) @ np.square([self.of_pose, self.to_one_side])
        return np.diag([x, x, heading])

    def array(self) -> Float64:
        """All of it, float64 (9,), for a map file."""
        last = [self.sharpness, self.trials, self.usual_contradiction]
        return np.concatenate([self.of_views, self.of_pose, self.to_one_side, last])

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
        if values.shape == (8,):
            # Of a map that was built before bands were looked at.
            values = np.append(values, math.inf)
        if values.shape != (9,) or not (np.isfinite(values[:8]).all() and (values >= 0.0).all()):
            return cls(UNKNOWN.of_views, UNKNOWN.of_pose, UNKNOWN.to_one_side, UNKNOWN.sharpness, 0)
        return cls(values[0:2], values[2:4], values[4:6], float(values[6]), int(values[7]), float(values[8]))


#: Where nothing can be learnt: 2 cm and 0.5 degrees, as of references that were surveyed with a tape; views as in the rendered hall.
UNKNOWN = SourceErrors(np.array([1.3, 1.2]), np.array([0.02, np.radians(0.5)]), np.zeros(2), 2.0, 0)
#: What the image shows, and nothing more.
NONE = SourceErrors(np.ones(2), np.zeros(2), np.zeros(2), 1.0, 0)

"""Whether images and given poses agree on how long a metre is.

Images tell the length of their baselines by the height of the camera above the floor. If that is described wrongly, all relative poses
are too long or too short alike, and a pose graph would stretch a good survey to fit them. Dead reckoning errs, too, but hardly in all
directions alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.map.keyframes import Edges
from panoloc_mcl.robot.map.pose_graph import Priors, solve

Float64 = NDArray[np.float64]

# A scale is off if it differs from 1 by so many standard deviations and by this share at least.
_CLEAR, _LEAST = 4.0, 0.02
# Standard deviation of what holds a graph in its place and bends nothing, metres and radians.
_HARDLY_KNOWN = 10.0


@dataclass(frozen=True)
class SurveyScale:
    """Lengths by the images over those of the survey.

    Parameters
    ----------
    ratio : float
    sd : float
        Its standard deviation.
    """

    ratio: float
    sd: float

    @classmethod
    def of(cls, poses: Float64, given: Float64, weights: Float64) -> SurveyScale:
        """From poses (n, 3) that fit the images, and given ones (n, 3) with weights (n,): a similarity, by least squares.

        Given poses are regressed on the others, as their errors are the larger ones: the other way round would shrink the ratio. A
        survey that drifts has errors that are alike for neighbours, so it looks stretched by more than its scatter explains, in some
        directions more than in others; by how much these differ tells how well such a survey knows its scale.
        """
        total = float(weights.sum())
        if total < 4.0:
            return cls(1.0, np.inf)
        own, theirs = (xy[:, :2] - weights @ xy[:, :2] / total for xy in (poses, given))
        along = float(weights @ (own * theirs).sum(axis=1))
        across = float(weights @ (own[:, 0] * theirs[:, 1] - own[:, 1] * theirs[:, 0]))
        extent = float(weights @ (own**2).sum(axis=1))
        if extent <= 0.0 or np.hypot(along, across) <= 0.0:
            return cls(1.0, np.inf)
        turned = np.array([[along, -across], [across, along]]) / extent
        left = theirs - own @ turned.T
        variance = float(weights @ (left**2).sum(axis=1)) / (2.0 * total - 4.0)
        shrunk = float(np.hypot(along, across)) / extent
        return cls(1.0 / shrunk, float(np.sqrt(variance / extent + _uneven(own, left, weights))) / shrunk**2)

    @classmethod
    def of_edges(cls, edges: Edges, poses: Float64, given: Float64, weights: Float64) -> SurveyScale:
        """From measured relative poses, put together without the given poses, which would hold them back from the metres of the images.

        Parameters
        ----------
        edges : Edges
        poses : float64 (n, 3)
            To start from.
        given : float64 (n, 3)
        weights : float64 (n,)
            Of the given poses.
        """
        hardly_known = Priors(given, np.full((len(given), 2), _HARDLY_KNOWN), robust=False)
        return cls.of(solve(poses, edges, hardly_known).poses, given, weights)

    @property
    def is_off(self) -> bool:
        """Whether images and survey clearly differ."""
        return abs(self.ratio - 1.0) > max(_CLEAR * self.sd, _LEAST)

    def of_survey(self, edges: Edges) -> Edges:
        """Measured relative poses in the metres of the survey."""
        return replace(edges, measured=edges.measured / [self.ratio, self.ratio, 1.0])

    def note(self, height_m: float) -> str:
        """What the user should know."""
        off = f"{100.0 * abs(self.ratio - 1.0):.0f} %"
        longer = "longer" if self.ratio > 1.0 else "shorter"
        return (
            f"camera.height_m = {height_m:g}: images make distances {off} {longer} than the given poses, "
            f"with {height_m / self.ratio:.3f} they would agree. Poses are mended in the metres that are given; correct the height, or "
            "run panoloc calibrate"
        )


def _uneven(own: Float64, left: Float64, weights: Float64) -> float:
    """Variance of a stretch that differs between directions, without what independent errors explain of it.

    Fits ``left`` (n, 2), what a similarity leaves, as linear in ``own`` (n, 2): a stretch along one axis and as much of a contraction
    across it, with two unknowns (along the axes and along the diagonals), as scale and turn of the similarity are two.
    """
    own, left = (np.sqrt(weights)[:, None] * xy for xy in (own, left))
    normal = own.T @ own
    if np.linalg.matrix_rank(normal) < 2:
        return 0.0
    inverse = np.linalg.inv(normal)
    linear = (inverse @ own.T @ left).T
    variance = float(np.sum((left - own @ linear.T) ** 2)) / (2.0 * float(weights.sum()) - 6.0)
    squares = float(0.25 * (linear[0, 0] - linear[1, 1]) ** 2 + 0.25 * (linear[0, 1] + linear[1, 0]) ** 2)
    return 0.5 * max(0.0, squares - 0.5 * variance * float(np.trace(inverse)))

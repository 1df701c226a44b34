"""Gauss-Newton equations of a pose and a tilt: the step that they ask for, and how far the pose may still be off.

How far it is off is told by the sectors of the circle, each of which pulls the pose a little to its own side: depths, light and what
moves err alike within a sector, and hardly from one to the next. The scatter of their pulls gives a covariance that holds whatever the
errors are (the sandwich estimator of clustered data, Liang & Zeger 1986). It is the scatter of few pulls, though, so it is drawn
towards the smooth covariance that pixels would give that err independently (shrinkage, as in Ledoit & Wolf 2004). What displaces all
sectors of a view alike, a wrong depth or a tilt of the reference that it was made from, shows between the views: each pulls the pose
to where it fits alone. All are right but for a factor that the map learns (`map_error`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.measurement import Agreement, cosine_of
from panoloc_mcl.robot.synthesis.agreeing_parts import Banded, contradiction

Float64 = NDArray[np.float64]

_LARGEST_STEP_M = 0.15
_LARGEST_TURN = np.radians(2.0)
_FARTHEST = np.array([_LARGEST_STEP_M, _LARGEST_STEP_M, _LARGEST_TURN])
# Steps that shrink to more than this share of the one before are taken to shrink to it.
_SLOWEST = 0.6
# Standard deviation of pitch and roll before the image is seen, radians.
_SD_TILT = np.radians(2.0)
# Neighbouring pixels and both channels err together: so many of them count as one.
_CORRELATED = 2.5
# Information is not thought smaller than this agreement makes it.
_LEAST_AGREEMENT = 0.1
# Mean squared difference at the least: a view that fits exactly, or shows nothing of the image, has none and still errs.
_LEAST_VARIANCE = 1e-4
# Share of the smooth covariance, and what the scatter between views counts beside both: likeliest on one drive a light of the rendered
# hall (those numbered 00), as it is, tilted by 4 degrees, and with a gain of 0.35 and of 2.2.
_SMOOTH, _BETWEEN = 0.6, 2.0
# A view that weighs more than this, squared, is nearly the only one: what the others say of it is not multiplied any further.
_ONE_SOURCE = 0.9
# Views agree on a position that they pull apart by less than this, in standard deviations that pixels give: seen on afternoon_02 of the
# rendered hall, where two poses inside a goal were 5 cm off and better ones beside them.
_SETTLED = 0.9
# Variances at the least: a tenth of a millimetre, a thousandth of a degree.
_LEAST_SCATTER = np.diag([1e-4, 1e-4, np.radians(1e-3)]) ** 2


class Views(NamedTuple):
    """Equations of an image and each of several views, which have weights (v,) of sum 1.

    Parameters
    ----------
    weights : float64 (v,)
    normals, rights : float64 (v, 5, 5) and (v, 5)
    """

    weights: Float64
    normals: Float64
    rights: Float64


class Equations(NamedTuple):
    """Of an image and the views around a pose.

    Parameters
    ----------
    normal : float64 (5, 5)
        Of x, y, heading, pitch and roll: metres and radians.
    right : float64 (5,)
    residual : float
        Sum of squared differences of the features.
    pixels : float
        Number of pixels compared.
    columns : float64 (3, b, c)
        Inner products of the image and the views, and both squared norms, of every band of rows and column.
    pulls : float64 (s, 5)
        Parts of ``right``, by sectors of the circle.
    views : Views, optional
        What it is the sum of; None where it is not known.
    banded : sequence of Banded
        The same, by bands of rows; empty where it is not known.
    """

    normal: Float64
    right: Float64
    residual: float
    pixels: float
    columns: Float64
    pulls: Float64
    views: Views | None = None
    banded: Sequence[Banded] = ()

    @property
    def cosine(self) -> float:
        """How far the image and the views show the same."""
        return cosine_of(*self.columns)

    @property
    def agreement(self) -> Agreement:
        """The same, and what each part of the image says of it."""
        return Agreement.of_columns(*self.columns)

    @property
    def variance(self) -> float:
        """Mean squared difference of a pixel."""
        return float(self.residual / max(self.pixels, 1.0))

    def step(self, tilt: Float64, unknowns: int) -> Float64:
        """The step of position, heading and tilt from a tilt (2,), of a length that can be trusted: float64 (5,)."""
        normal, right = self._regular(unknowns), self.right.copy()
        right[3:] -= self._stiffness * tilt
        step = np.zeros(5)
        step[:unknowns] = np.linalg.solve(normal, right[:unknowns])
        step[:2] *= min(1.0, _LARGEST_STEP_M / max(float(np.hypot(step[0], step[1])), 1e-12))
        step[2] = np.clip(step[2], -_LARGEST_TURN, _LARGEST_TURN)
        return step

    def covariance(self, unknowns: int) -> Float64:
        """Of the pose, by the pulls of sectors and views and the noise of the pixels, but for a factor: float64 (3, 3)."""
        noise = self.noise(unknowns)
        seen = int(self.pulls.any(axis=1).sum())
        if seen < 2 * unknowns:
            # So few do not tell how they scatter.
            return noise
        moved = np.linalg.solve(self._regular(unknowns), self.pulls[:, :unknowns].T)[:3]
        # As many degrees of freedom as unknowns are spent.
        scatter = np.asarray((moved @ moved.T) * (seen / (seen - unknowns)))
        return np.asarray((1.0 - _SMOOTH) * scatter + _SMOOTH * noise + _BETWEEN * self._between(unknowns) + _LEAST_SCATTER)

    def _between(self, unknowns: int) -> Float64:
        """Covariance of the pose by what the views pull it apart, float64 (3, 3): that of a weighted mean; zeros of a single view."""
        if self.views is None or len(self.views.weights) < 2:
            return np.zeros((3, 3))
        weights, normals, rights = self.views
        alone = np.array([self._regularised(normal, unknowns) for normal in normals])
        steps = np.linalg.solve(alone, rights[:, :unknowns, None])[:, :3, 0]
        # A view that shows next to nothing goes anywhere.
        steps = np.clip(steps, -_FARTHEST, _FARTHEST)
        apart = weights[:, None] * (steps - weights @ steps)
        return np.asarray(apart.T @ apart / (1.0 - min(float(weights @ weights), _ONE_SOURCE)))

    def settled(self, unknowns: int) -> bool:
        """Whether all views agree on the pose, as far as the noise of the pixels lets expect; where not, another may be near by."""
        return float(np.trace(self._between(unknowns)[:2, :2])) < _SETTLED**2 * float(np.trace(self.noise(unknowns)[:2, :2]))

    def contradiction(self, row_step: float) -> float:
        """How far bands of rows contradict each other about the pose: about 1 where noise alone does, more where the camera is not as
        it is described.
        """
        return contradiction(self.banded, row_step, _CORRELATED * max(self.variance, _LEAST_VARIANCE))

    def noise(self, unknowns: int) -> Float64:
        """Covariance of the pose if pixels erred independently of each other, float64 (3, 3)."""
        inverse = np.linalg.inv(self.normal[:unknowns, :unknowns] + 1e-9 * np.eye(unknowns))[:3, :3]
        # Noise has gradients, too, which tell nothing of the pose: what is not agreed upon must not count as information.
        trusted = float(np.clip(self.cosine, _LEAST_AGREEMENT, 1.0))
        return np.asarray(_CORRELATED * max(self.variance, _LEAST_VARIANCE) / trusted**2 * inverse)

    @property
    def _stiffness(self) -> float:
        """What is known of the tilt beforehand, in the units of the residuals."""
        return float(self.variance / _SD_TILT**2)

    def _regular(self, unknowns: int) -> Float64:
        return self._regularised(self.normal, unknowns)

    def _regularised(self, normal: Float64, unknowns: int) -> Float64:
        normal = normal.copy()
        normal[[3, 4], [3, 4]] += self._stiffness
        return np.asarray(normal[:unknowns, :unknowns] + (1e-9 * np.trace(normal[:3, :3]) + 1e-12) * np.eye(unknowns))


def limit_of(step: Float64, before: Float64) -> Float64:
    """Where a step and all that would follow lead, if each is to the one before as this one is: a geometric series (Aitken 1926).

    Steps are too short where image and view show the same only in part, as some of their edges have no counterpart: in an image of
    the rendered hall each leaves a quarter of the way, in one that is saturated for a tenth of its pixels a half.

    Parameters
    ----------
    step, before : float64 (5,)
        Of position, heading and tilt; the position tells how fast they shrink. Zeros for ``before`` where there is none.

    Returns
    -------
    float64 (5,)
        At least the step itself, and at most 2.5 times as much.
    """
    shrinks = float(step[:2] @ before[:2]) / max(float(before[:2] @ before[:2]), 1e-12)
    return step / (1.0 - min(max(shrinks, 0.0), _SLOWEST))

"""A pose that one image gives by itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference

# Sectors that vote on a pose, so many over the circle.
_SECTORS = 24
# A sector with less than this share of the sectors' mean energy is not seen.
_SEEN = 0.1


@dataclass(frozen=True, eq=False)
class Agreement:
    """How far an image and the view synthesised at a pose show the same, over what both show.

    The sectors are voters: at the true pose nearly all of them agree, and those that do not are hidden; at a wrong one a few do by
    chance.

    Parameters
    ----------
    cosine : float
        Of all pixels together: 1 when they are the same.
    sectors : float64 (s,)
        The same for every sector of the circle; NaN where nothing is seen.
    """

    cosine: float
    sectors: NDArray[np.float64]

    @classmethod
    def of_columns(cls, common: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]) -> Agreement:
        """From inner products and squared norms of every column, float64 (columns,)."""
        edges = np.linspace(0, len(common), min(_SECTORS, len(common)), endpoint=False).astype(np.int64)
        summed, one, other = (np.add.reduceat(part, edges) for part in (common, first, second))
        # Where hardly anything is seen, chance alone would vote.
        seen = np.minimum(one, other) > _SEEN * np.minimum(one, other).mean()
        sectors = np.full(len(edges), np.nan)
        sectors[seen] = summed[seen] / np.sqrt(one[seen] * other[seen])
        return cls(float(common.sum() / np.sqrt(max(first.sum() * second.sum(), 1e-24))), sectors)

    @property
    def unanimity(self) -> float:
        """Mean agreement of the sectors in standard errors of itself: how surely it is not chance; 0 with fewer than two."""
        seen = self.sectors[np.isfinite(self.sectors)]
        if len(seen) < 2:
            return 0.0
        spread = float(seen.std(ddof=1))
        return float(seen.mean() * np.sqrt(len(seen))) / max(spread, 1e-3)


@dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """A pose read off one image.

    Parameters
    ----------
    pose : float64 (3,)
        x, y, heading; metres and radians.
    covariance : float64 (3, 3)
    tilt : float64 (2,)
        Pitch and roll of the camera against the references: a rotation vector about the robot's axes to the left (positive: nose down)
        and ahead (positive: right side down), radians.
    agreement : Agreement
        Between the image and the view synthesised at the pose.
    of_map : float64 (3, 3), optional
        The part of the covariance that is the map's: all images nearby err by the same. None by default.
    of_frame : float64 (3, 3), optional
        The part that all images in the map share, as a mended map may float as a whole. None by default.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    tilt: NDArray[np.float64]
    agreement: Agreement
    of_map: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    of_frame: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))

    def relative_likelihood(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gaussian likelihood of poses (n, 3) relative to that of the measured pose: 1 there, float64 (n,)."""
        residuals = poses - self.pose
        residuals[:, 2] = angle_difference(poses[:, 2], self.pose[2])
        whitened = np.linalg.solve(np.linalg.cholesky(self.covariance), residuals.T)
        return np.asarray(np.exp(-0.5 * np.sum(whitened * whitened, axis=0)))

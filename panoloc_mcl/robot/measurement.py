"""A pose that one image gives by itself."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

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
    chance. So are bands of rows: at a place that has the floor of the true one, only the lower ones agree.

    Parameters
    ----------
    cosine : float
        Of all pixels together: 1 when they are the same.
    sectors : float64 (s,)
        The same for every sector of the circle, in every band of rows; NaN where nothing is seen.
    weakest : float
        The same for the band of rows that agrees least, of those where much is seen.
    """

    cosine: float
    sectors: NDArray[np.float64]
    weakest: float

    @classmethod
    def of_columns(cls, common: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]) -> Agreement:
        """From inner products and squared norms of every column, float64 (columns,), or of every band and column (bands, columns)."""
        bands = [np.atleast_2d(part) for part in (common, first, second)]
        columns = bands[0].shape[1]
        edges = np.linspace(0, columns, min(_SECTORS, columns), endpoint=False).astype(np.int64)
        sectors = _cosines(*(np.add.reduceat(part, edges, axis=1) for part in bands)).ravel()
        by_band = _cosines(*(part.sum(axis=1) for part in bands))
        cosine = cosine_of(common, first, second)
        return cls(cosine, sectors, float(np.nanmin(by_band)) if np.isfinite(by_band).any() else cosine)

    @property
    def unanimity(self) -> float:
        """Mean agreement of the sectors in standard errors of itself: how surely it is not chance; 0 with fewer than two."""
        seen = self.sectors[np.isfinite(self.sectors)]
        if len(seen) < 2:
            return 0.0
        spread = float(seen.std(ddof=1))
        return float(seen.mean() * np.sqrt(len(seen))) / max(spread, 1e-3)


def growth(excess: float) -> float:
    """Of a covariance where floor and walls contradict each other by so much more than usual."""
    # The square was chosen on the rendered hall, seen by a camera whose centre is off by 2 and 5 pixels, and whose elevations are
    # off by 1 and 3 degrees, by 3 and 10 %: little is added just beyond what is usual, and enough far beyond it.
    return 1.0 + excess * excess


def cosine_of(common: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Of all pixels together, from inner products and squared norms of any parts."""
    return float(common.sum() / np.sqrt(max(first.sum() * second.sum(), 1e-24)))


def _cosines(common: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Agreement of every part; NaN where hardly anything is seen, as chance alone would vote there."""
    least = np.minimum(first, second)
    seen = least > _SEEN * least.mean()
    found = np.full(common.shape, np.nan)
    found[seen] = common[seen] / np.sqrt(first[seen] * second[seen])
    return found


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
    contradiction : float, optional
        How far floor and walls contradict each other about the pose: 1 for noise, more where the camera is not as it is described.
    excess : float, optional
        By how much that is more than in nearly all images of the map, 0 if it is not; the covariance is wider for it.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    tilt: NDArray[np.float64]
    agreement: Agreement
    of_map: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    of_frame: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    contradiction: float = 0.0
    excess: float = 0.0

    @property
    def unusual(self) -> bool:
        """Whether floor and walls contradict each other more than in images of the map."""
        return self.excess > 0.0

    def widened(self, excess: float) -> PoseMeasurement:
        """The same with a covariance as of an image whose floor and walls contradict each other by so much, if its own do so less."""
        if excess <= self.excess:
            return self
        shared = self.of_map + self.of_frame
        return replace(self, covariance=(self.covariance - shared) * growth(excess) / growth(self.excess) + shared)

    def relative_likelihood(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gaussian likelihood of poses (n, 3) relative to that of the measured pose: 1 there, float64 (n,)."""
        residuals = poses - self.pose
        residuals[:, 2] = angle_difference(poses[:, 2], self.pose[2])
        whitened = np.linalg.solve(np.linalg.cholesky(self.covariance), residuals.T)
        return np.asarray(np.exp(-0.5 * np.sum(whitened * whitened, axis=0)))

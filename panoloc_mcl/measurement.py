"""A pose that one image gives by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.geometry import angle_difference


@dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """A pose read off one image.

    Parameters
    ----------
    pose : float64 (3,)
        x, y, heading; metres and radians.
    covariance : float64 (3, 3)
    tilt : float64 (2,)
        Pitch and roll of the camera, radians.
    agreement : float
        Cosine between the image and the view synthesised at the pose, over what both show: 1 when they are the same.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    tilt: NDArray[np.float64]
    agreement: float

    def relative_likelihood(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gaussian likelihood of poses (n, 3) relative to that of the measured pose: 1 there, float64 (n,)."""
        residuals = poses - self.pose
        residuals[:, 2] = angle_difference(poses[:, 2], self.pose[2])
        whitened = np.linalg.solve(np.linalg.cholesky(self.covariance), residuals.T)
        return np.asarray(np.exp(-0.5 * np.sum(whitened * whitened, axis=0)))

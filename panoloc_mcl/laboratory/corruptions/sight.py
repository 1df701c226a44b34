"""What the pixels of a camera's images look at, and what an image shows in a direction.

Azimuths are positive to the left of where the camera looks, elevations above the horizon; both in radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.rays import directions_of
from panoloc_mcl.robot.camera.directions import pixels_of
from panoloc_mcl.robot.camera.spec import AnyCamera, EquirectangularCamera, PanoramaCamera

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Columns that interpolation reaches across the seam.
_SEAM = 2


@dataclass(frozen=True, eq=False)
class Sight:
    """Rays of a camera.

    Parameters
    ----------
    camera : AnyCamera
    size : (int, int)
        Width and height of its images.
    azimuth, elevation : float64 (height, width)
        Of the pixels' centres.
    seen : bool (height, width)
        Where the camera sees anything.
    """

    camera: AnyCamera
    size: tuple[int, int]
    azimuth: Float64
    elevation: Float64
    seen: NDArray[np.bool_]

    @property
    def goes_round(self) -> bool:
        """Whether the first column follows the last."""
        return isinstance(self.camera, PanoramaCamera | EquirectangularCamera)

    @property
    def field(self) -> tuple[float, float]:
        """Lowest and highest elevation that is seen."""
        seen = self.elevation[self.seen]
        return float(seen.min()), float(seen.max())

    @property
    def pixels_per_degree(self) -> float:
        """Of azimuth in a panorama; elsewhere, root of the pixels over the part of the sphere that they see."""
        if self.goes_round:
            return self.size[0] / 360.0
        low, high = self.field
        return math.sqrt(float(self.seen.sum()) / (2.0 * math.pi * (math.sin(high) - math.sin(low)))) * math.pi / 180.0

    def pixels_of(self, azimuth: Float64, elevation: Float64) -> tuple[Float64, Float64]:
        """Columns and rows (floats) at which directions lie; elevations beyond the image lie at its rim."""
        low, high = self.field
        u, v, _ = pixels_of(self.camera, self.size, azimuth, np.clip(elevation, low, high))
        return u, v

    def sample(self, image: Float32, azimuth: Float64, elevation: Float64) -> Float32:
        """What an image shows in given directions, interpolated by cubics.

        Parameters
        ----------
        image : float32 (height, width) or (height, width, channels)
        azimuth, elevation : float64 (rows, columns)
        """
        column, row = self.pixels_of(azimuth, elevation)
        if self.goes_round:
            image = cv2.copyMakeBorder(image, 0, 0, _SEAM, _SEAM, cv2.BORDER_WRAP)
            column = column + _SEAM
        u, v = (np.nan_to_num(part, nan=-10.0).astype(np.float32) for part in (column, row))
        found = cv2.remap(image, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(np.maximum(found, 0.0), dtype=np.float32)


def sight_of(camera: AnyCamera, size: tuple[int, int]) -> Sight:
    """The rays of a camera."""
    width, height = size
    column, row = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    return Sight(camera, size, *directions_of(camera, size, column, row))

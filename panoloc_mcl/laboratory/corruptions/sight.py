"""Which way every pixel of a camera's images looks, and where in the image a direction lies.

Azimuths are positive to the left of the robot's heading, elevations above the horizon; both in radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.camera.spec import Camera, OmniCamera, PanoramaCamera
from panoloc_mcl.robot.errors import ConfigError

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Columns that interpolation reaches across the seam.
_SEAM = 2
_PROFILE_STEPS = 36001


@dataclass(frozen=True, eq=False)
class Sight:
    """Rays of a camera.

    Parameters
    ----------
    camera : PanoramaCamera or OmniCamera
    size : (int, int)
        Width and height of its images.
    azimuth, elevation : float64 (height, width)
        Of the pixels' centres.
    seen : bool (height, width)
        Where the camera sees anything.
    """

    camera: PanoramaCamera | OmniCamera
    size: tuple[int, int]
    azimuth: Float64
    elevation: Float64
    seen: NDArray[np.bool_]

    @property
    def field(self) -> tuple[float, float]:
        """Lowest and highest elevation that is seen."""
        seen = self.elevation[self.seen]
        return float(seen.min()), float(seen.max())

    @property
    def pixels_per_degree(self) -> float:
        """Of azimuth in a panorama, of elevation in a raw image."""
        if isinstance(self.camera, PanoramaCamera):
            return self.size[0] / 360.0
        low, high = self.field
        inner, outer = self.camera.valid_radius_px
        return (outer - inner) / math.degrees(high - low)

    def pixels_of(self, azimuth: Float64, elevation: Float64) -> tuple[Float64, Float64]:
        """Columns and rows (floats) at which directions lie; elevations beyond the image lie at its rim."""
        width, height = self.size
        if isinstance(self.camera, PanoramaCamera):
            sense = -1.0 if self.camera.columns == "clockwise" else 1.0
            column = np.mod(self.camera.heading_column + sense * azimuth * width / (2.0 * np.pi), width)
            bottom, top = np.radians(self.camera.elevation_deg)
            row = (elevation - top) * (height / (bottom - top)) - 0.5
            return column, np.clip(row, 0.0, height - 1.0)
        low, high = self.field
        radius = radius_px(self.camera.profile, np.clip(elevation, low, high))
        angle = azimuth if self.camera.azimuth == "counterclockwise" else -azimuth
        angle = angle + math.radians(self.camera.heading_angle_deg)
        center = self.camera.center_px
        return center[0] + radius * np.cos(angle), center[1] - radius * np.sin(angle)

    def sample(self, image: Float32, azimuth: Float64, elevation: Float64) -> Float32:
        """What an image shows in given directions, interpolated by cubics.

        Parameters
        ----------
        image : float32 (height, width) or (height, width, channels)
        azimuth, elevation : float64 (rows, columns)
        """
        column, row = self.pixels_of(azimuth, elevation)
        if isinstance(self.camera, PanoramaCamera):
            image = cv2.copyMakeBorder(image, 0, 0, _SEAM, _SEAM, cv2.BORDER_WRAP)
            column = column + _SEAM
        found = cv2.remap(
            image, column.astype(np.float32), row.astype(np.float32), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(np.maximum(found, 0.0), dtype=np.float32)


def sight_of(camera: Camera, size: tuple[int, int]) -> Sight:
    """The rays of a camera.

    Raises
    ------
    ConfigError
        A kind of camera whose images cannot be corrupted.
    """
    width, height = size
    column, row = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    if isinstance(camera, PanoramaCamera):
        sense = -1.0 if camera.columns == "clockwise" else 1.0
        azimuth = sense * 2.0 * np.pi * (column - camera.heading_column) / width
        bottom, top = np.radians(camera.elevation_deg)
        elevation = top + (row + 0.5) * ((bottom - top) / height)
        return Sight(camera, size, _wrapped(azimuth), elevation, np.ones((height, width), dtype=np.bool_))
    if not isinstance(camera, OmniCamera):
        raise ConfigError(f"camera.kind = {camera.kind}: its images cannot be corrupted; use panorama or omni")
    x, y = column - camera.center_px[0], camera.center_px[1] - row
    radius, angle = np.hypot(x, y), np.arctan2(y, x) - math.radians(camera.heading_angle_deg)
    elevation = elevation_at(camera, radius)
    inner, outer = camera.valid_radius_px
    seen = (radius >= inner) & (radius <= outer) & np.isfinite(elevation)
    azimuth = angle if camera.azimuth == "counterclockwise" else -angle
    return Sight(camera, size, _wrapped(azimuth), np.where(seen, elevation, 0.0), seen)


def elevation_at(camera: OmniCamera, radius: Float64) -> Float64:
    """The profile turned round by a fine table; NaN where no elevation is imaged."""
    elevations = np.radians(np.linspace(-90.0, 90.0, _PROFILE_STEPS))
    radii = radius_px(camera.profile, elevations)
    known = np.isfinite(radii)
    r, e = radii[known], elevations[known]
    if r[-1] < r[0]:
        r, e = r[::-1], e[::-1]
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(r)) > 0.0])
    return np.asarray(np.interp(radius, r[rising], e[rising], left=np.nan, right=np.nan), dtype=np.float64)


def _wrapped(angle: Float64) -> Float64:
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)

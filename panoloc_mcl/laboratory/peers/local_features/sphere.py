"""A panorama as a strip of an equirectangular sphere, which is a camera that COLMAP knows.

Rows of a panorama are linear in elevation and its columns in azimuth, so it is part of such a sphere already; only its pixels are not
square. The strip is enlarged to square ones, repeated a little beyond the seam, and what lies above and below it is never made:
features are found on the strip and numbered as pixels of the whole sphere.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.errors import MapError

Float64 = NDArray[np.float64]

# Beyond the seam the strip is repeated for so many of its columns, and features are kept that lie within.
_MARGIN_SHARE = 32
_Z = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Sphere:
    """The equirectangular sphere that a panorama is a strip of.

    Parameters
    ----------
    geometry : PanoramaGeometry
    width : int
        Columns of the sphere; it has half as many rows. The robot's heading lies in the middle, as COLMAP has it.
    """

    geometry: PanoramaGeometry
    width: int

    @property
    def height(self) -> int:
        """Rows."""
        return self.width // 2

    @property
    def _margin(self) -> int:
        return self.width // _MARGIN_SHARE

    @property
    def _top(self) -> float:
        """Where the strip begins, rows of the sphere."""
        return (90.0 - self.geometry.elevation_top_deg) / 180.0 * self.height

    def strip(self, pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
        """A panorama (rows, columns) enlarged, uint8 (rows, width + 2 margins)."""
        top, bottom = np.radians(self.geometry.elevation_top_deg), np.radians(self.geometry.elevation_bottom_deg)
        rows = round((top - bottom) / np.pi * self.height)
        elevation = top - (np.arange(rows) + 0.5) * (np.pi / self.height)
        azimuth = np.pi - (np.arange(-self._margin, self.width + self._margin) + 0.5) * (2.0 * np.pi / self.width)
        at_row = np.clip(self.geometry.row_of_elevation(elevation), 0.0, self.geometry.height - 1.0)
        border = 4
        columns, across = np.meshgrid(self.geometry.column_of_azimuth(azimuth) + border, at_row)
        circle = cv2.copyMakeBorder(np.ascontiguousarray(pixels, dtype=np.float32), 0, 0, border, border, cv2.BORDER_WRAP)
        strip = cv2.remap(
            circle, columns.astype(np.float32), across.astype(np.float32), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(np.clip(np.rint(strip), 0.0, 255.0), dtype=np.uint8)

    def on_sphere(self, found: Float64) -> tuple[Float64, NDArray[np.bool_]]:
        """Pixels of the sphere (n, 2) of points in the strip (x, y; corners at 0), and which lie between its margins."""
        points = found + np.array([-self._margin, self._top])
        return points, (points[:, 0] >= 0.0) & (points[:, 0] < self.width)

    def seen(self, points: Float64, valid: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        """Which pixels of the sphere (n, 2) lie in the visible part of a panorama."""
        if valid is None:
            return np.ones(len(points), dtype=np.bool_)
        azimuth = np.pi - points[:, 0] * (2.0 * np.pi / self.width)
        elevation = 0.5 * np.pi - points[:, 1] * (np.pi / self.height)
        rows = np.clip(np.rint(self.geometry.row_of_elevation(elevation)), 0, self.geometry.height - 1).astype(np.int64)
        return np.asarray(valid[rows, np.rint(self.geometry.column_of_azimuth(azimuth)).astype(np.int64) % self.geometry.width])

    def camera(self) -> Any:
        """COLMAP's camera of the sphere."""
        colmap = pycolmap()
        return colmap.Camera.create_from_model_id(1, colmap.CameraModelId.EQUIRECTANGULAR, 1.0, self.width, self.height)


def cam_from_world(pose: Float64) -> Any:
    """COLMAP's pose of an upright camera (x to the right, y down, z ahead) at x, y and heading on the plane z = 0."""
    ahead = np.array([np.cos(pose[2]), np.sin(pose[2]), 0.0])
    rotation = np.stack([np.cross(_Z, ahead), _Z, ahead])
    return pycolmap().Rigid3d(pycolmap().Rotation3d(rotation), -rotation @ np.array([pose[0], pose[1], 0.0]))


def pose_on_plane(rigid: Any) -> Float64:
    """x, y and heading of a pose of COLMAP's, float64 (3,)."""
    rotation = np.asarray(rigid.rotation.matrix())
    centre = -rotation.T @ np.asarray(rigid.translation)
    return np.array([centre[0], centre[1], np.arctan2(rotation[2, 1], rotation[2, 0])])


def pycolmap() -> Any:
    """The package.

    Raises
    ------
    MapError
        It is not installed.
    """
    package = extra("pycolmap")
    # It tells standard error of every step, and that there are no images to take colours from.
    package.logging.minloglevel = package.logging.Level.ERROR.value
    return package


def extra(name: str) -> Any:
    """A package of the extra ``peers``.

    Raises
    ------
    MapError
        It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MapError(f"this peer needs {name}; install the extra: pip install 'panoloc-mcl[peers]'") from error

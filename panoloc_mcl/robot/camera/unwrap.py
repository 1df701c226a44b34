"""Turns camera images into canonical panoramas with a table computed once."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera.panorama import Panorama, PanoramaGeometry
from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.camera.spec import OmniCamera, PanoramaCamera
from panoloc_mcl.robot.errors import CameraError, ImageError

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_WHOLE = 1e-6  # pixels; positions this close to whole ones are copied, not interpolated
_SEAM = 2  # columns a cubic kernel reaches across the seam
_MOST_SAMPLES = 8  # along an axis of a target pixel


def geometry_of(camera: PanoramaCamera | OmniCamera, image_size: tuple[int, int]) -> PanoramaGeometry:
    """The canonical panorama that a camera's images carry by themselves.

    Parameters
    ----------
    camera : PanoramaCamera or OmniCamera
    image_size : (int, int)
        Width and height of its images; an omnidirectional camera names the panorama's size itself.

    Raises
    ------
    CameraError
        Images too small to be a panorama.
    """
    if isinstance(camera, OmniCamera):
        return PanoramaGeometry(*camera.panorama.size, *camera.panorama.elevation_deg)
    return PanoramaGeometry(*image_size, *camera.elevation_deg)


class Unwrapper:
    """Makes canonical panoramas of one camera's images.

    Parameters
    ----------
    camera : PanoramaCamera or OmniCamera
    image_size : (int, int)
        Width and height of the images it will be given.
    geometry : PanoramaGeometry
        The panorama to make.
    turn : float
        Radians. Gives the panorama that the camera would have delivered had the robot turned left by so much; -theta brings
        an image taken at heading theta to heading 0. Turns by whole columns copy pixels and do not interpolate.

    Raises
    ------
    CameraError
        The camera sees no pixel of the panorama.
    """

    def __init__(
        self,
        camera: PanoramaCamera | OmniCamera,
        image_size: tuple[int, int],
        geometry: PanoramaGeometry,
        turn: float = 0.0,
    ) -> None:
        if not math.isfinite(turn):
            raise CameraError(f"turn = {turn}: must be a finite angle in radians")
        self.camera, self.image_size, self.geometry, self.turn = camera, image_size, geometry, turn
        self._rows: NDArray[np.intp] | None = None
        self._columns: NDArray[np.intp] | None = None
        self._samples = (1, 1)
        self._wraps = isinstance(camera, PanoramaCamera)
        seen = self._tabulate_panorama(camera) if isinstance(camera, PanoramaCamera) else self._tabulate_omni(camera)
        if not seen.any():
            raise CameraError(
                f"camera: images of {image_size[0]} x {image_size[1]} show no elevation of the panorama "
                f"[{geometry.elevation_bottom_deg:g}, {geometry.elevation_top_deg:g}] degrees; "
                "check elevation_deg, center_px and valid_radius_px"
            )
        self.valid: NDArray[np.bool_] | None = None if seen.all() else seen

    def __call__(self, image: Image) -> Panorama:
        """Unwrap one image.

        Parameters
        ----------
        image : ndarray of uint8 or uint16, shape (height, width) or (height, width, 1 | 3 | 4)
            Grey, BGR or BGRA. 16 bits are scaled to 0..255.

        Raises
        ------
        ImageError
            Another type, number of channels or size than the table was made for.
        """
        grey = self._checked_grey(image)
        scale = 255.0 / 65535.0 if grey.dtype == np.uint16 else 1.0
        pixels = self._interpolated(grey) if self._rows is None else self._copied(grey)
        if scale != 1.0:
            pixels *= np.float32(scale)
        if self.valid is not None:
            pixels[~self.valid] = 0.0
        return Panorama(pixels, self.valid)

    def _checked_grey(self, image: Image) -> Image:
        if not isinstance(image, np.ndarray) or image.dtype not in (np.uint8, np.uint16):
            kind = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
            raise ImageError(f"image of type {kind}: must be 8- or 16-bit unsigned grey levels; convert it")
        width, height = self.image_size
        if image.shape[:2] != (height, width):
            found = " x ".join(str(n) for n in image.shape[1::-1])
            raise ImageError(f"image of {found} pixels: this camera delivers {width} x {height}; use its own images")
        if image.ndim == 2:
            return image
        if image.ndim == 3 and image.shape[2] == 1:
            return image[:, :, 0]
        if image.ndim == 3 and image.shape[2] in (3, 4):
            code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
            grey: Image = cv2.cvtColor(image, code)
            return grey
        raise ImageError(f"image of shape {image.shape}: must be grey, BGR or BGRA")

    def _copied(self, grey: Image) -> NDArray[np.float32]:
        if self._rows is not None and not _is_identity(self._rows, grey.shape[0]):
            grey = grey[self._rows]
        if self._columns is not None and not _is_identity(self._columns, grey.shape[1]):
            grey = grey[:, self._columns]
        return grey.astype(np.float32)

    def _interpolated(self, grey: Image) -> NDArray[np.float32]:
        across, down = self._samples
        sampled = across * down > 1
        source = grey if sampled else grey.astype(np.float32)
        if self._wraps:
            source = cv2.copyMakeBorder(source, 0, 0, _SEAM, _SEAM, cv2.BORDER_WRAP)
        kernel = cv2.INTER_LINEAR if sampled else cv2.INTER_CUBIC
        fine = cv2.remap(source, self._map_1, self._map_2, kernel, borderMode=cv2.BORDER_REPLICATE)
        if sampled:
            # The mean of the samples within each target pixel.
            size = (self.geometry.width, self.geometry.height)
            pixels: NDArray[np.float32] = cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA)
            return pixels
        limit = 65535.0 if grey.dtype == np.uint16 else 255.0
        # A cubic kernel overshoots at edges.
        clipped: NDArray[np.float32] = np.clip(fine, 0.0, limit)
        return clipped

    def _tabulate_panorama(self, camera: PanoramaCamera) -> NDArray[np.bool_]:
        width, height = self.image_size
        source = geometry_of(camera, self.image_size)
        row_deg = (self.geometry.elevation_top_deg - self.geometry.elevation_bottom_deg) / self.geometry.height
        down = _samples(row_deg * height / (source.elevation_top_deg - source.elevation_bottom_deg))
        across = _samples(width / self.geometry.width)
        self._samples = (across, down)
        fine_columns, fine_rows = self._fine_grid()
        sense = 1.0 if camera.columns == "clockwise" else -1.0
        offset = fine_columns - self.turn * self.geometry.width / (2.0 * np.pi)
        columns = np.mod(camera.heading_column + sense * offset * (width / self.geometry.width), width)
        rows = source.row_of_elevation(self.geometry.elevation_of_row(fine_rows))
        seen_rows = np.asarray((rows > -0.5 - _WHOLE) & (rows < height - 0.5 + _WHOLE))
        if across * down == 1 and _are_whole(columns) and _are_whole(rows):
            self._columns = np.rint(columns).astype(np.intp) % width
            self._rows = np.clip(np.rint(rows), 0, height - 1).astype(np.intp)
        else:
            self._set_maps(*np.meshgrid(columns + _SEAM, np.clip(rows, 0, height - 1)))
        seen = np.asarray(seen_rows.reshape(-1, down).all(axis=1))
        return np.repeat(seen[:, None], self.geometry.width, axis=1)

    def _tabulate_omni(self, camera: OmniCamera) -> NDArray[np.bool_]:
        width, height = self.image_size
        inner, outer = camera.valid_radius_px
        coarse = radius_px(camera.profile, self.geometry.elevation_of_row(np.arange(self.geometry.height)))
        used = coarse[(coarse >= inner) & (coarse <= outer)]
        largest, step = (np.max(used), np.max(np.abs(np.diff(used)), initial=1.0)) if used.size else (1.0, 1.0)
        across, down = _samples(2.0 * np.pi * largest / self.geometry.width), _samples(step)
        self._samples = (across, down)
        fine_columns, fine_rows = self._fine_grid()
        azimuth = self.geometry.azimuth_of_column(fine_columns) + self.turn
        sense = 1.0 if camera.azimuth == "counterclockwise" else -1.0
        image_angle = math.radians(camera.heading_angle_deg) + sense * azimuth
        radius = radius_px(camera.profile, self.geometry.elevation_of_row(fine_rows))
        u = camera.center_px[0] + np.outer(radius, np.cos(image_angle))
        # v points down while angles in the image count up from +u towards the top.
        v = camera.center_px[1] - np.outer(radius, np.sin(image_angle))
        in_ring = ((radius >= inner - _WHOLE) & (radius <= outer + _WHOLE))[:, None]
        with np.errstate(invalid="ignore"):
            seen = np.asarray(in_ring & (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5))
        self._set_maps(np.nan_to_num(u, nan=-1.0), np.nan_to_num(v, nan=-1.0))
        by_pixel = seen.reshape(self.geometry.height, down, self.geometry.width, across)
        return np.asarray(by_pixel.all(axis=(1, 3)))

    def _fine_grid(self) -> tuple[FloatArray, FloatArray]:
        """Columns and rows of the sample points, in pixels of the target."""
        across, down = self._samples
        columns = (np.arange(self.geometry.width * across) + 0.5) / across - 0.5
        rows = (np.arange(self.geometry.height * down) + 0.5) / down - 0.5
        return columns, rows

    def _set_maps(self, u: FloatArray, v: FloatArray) -> None:
        # Fixed-point tables are several times faster for integer images; cubic sampling of floats takes plain ones.
        self._map_1, self._map_2 = u.astype(np.float32), v.astype(np.float32)
        if self._samples != (1, 1):
            self._map_1, self._map_2 = cv2.convertMaps(self._map_1, self._map_2, cv2.CV_16SC2)


def _samples(shrink: float) -> int:
    """Sample points along an axis of a target pixel that covers ``shrink`` source pixels, against aliasing."""
    return int(np.clip(np.rint(shrink), 1, _MOST_SAMPLES))


def _are_whole(values: ArrayLike) -> bool:
    v = np.asarray(values)
    return bool(np.all(np.abs(v - np.rint(v)) < _WHOLE))


def _is_identity(index: NDArray[np.intp], size: int) -> bool:
    return len(index) == size and bool(index[0] == 0) and bool(np.all(np.diff(index) == 1))

"""Turns camera images into canonical panoramas with a table computed once."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera.directions import Pixels, angles_of, pixels_of, rays_of, row_of_elevation
from panoloc_mcl.robot.camera.extent import geometry_of
from panoloc_mcl.robot.camera.panorama import Panorama, PanoramaGeometry, shifted
from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.camera.spec import (
    AnyCamera,
    EquirectangularCamera,
    FisheyePairCamera,
    LensCamera,
    OmniCamera,
    PanoramaCamera,
)
from panoloc_mcl.robot.errors import CameraError, ImageError

__all__ = ["Unwrapper", "geometry_of"]

FloatArray = NDArray[np.float64]
Bool = NDArray[np.bool_]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_WHOLE = 1e-6  # pixels; positions this close to whole ones are copied, not interpolated
_SEAM = 2  # columns a cubic kernel reaches across the seam
_MOST_SAMPLES = 8  # along an axis of a target pixel
# Steps from pixel to pixel at this quantile say how much smaller the panorama is: at seams and poles they are far larger.
_USUAL_STEP = 0.9


class Unwrapper:
    """Makes canonical panoramas of one camera's images: upright, as seen from the camera, column 0 along the base's heading.

    Parameters
    ----------
    camera : AnyCamera
    image_size : (int, int)
        Width and height of the images it will be given.
    geometry : PanoramaGeometry
        The panorama to make.
    turn : float
        Radians. Gives the panorama that the camera would have delivered had the robot turned left by so much; -theta brings
        an image taken at heading theta to heading 0. Turns of a cylinder by whole columns copy pixels, others of one of the same
        columns shift it by its spectrum (`shifted`).

    Raises
    ------
    CameraError
        The camera sees no pixel of the panorama, or its calibration or mask is for images of another size.
    """

    def __init__(
        self,
        camera: AnyCamera,
        image_size: tuple[int, int],
        geometry: PanoramaGeometry,
        turn: float = 0.0,
    ) -> None:
        if not math.isfinite(turn):
            raise CameraError(f"turn = {turn}: must be a finite angle in radians")
        _check_size(camera, image_size)
        self.camera, self.image_size, self.geometry, self.turn = camera, image_size, geometry, turn
        self._rows: NDArray[np.intp] | None = None
        self._columns: NDArray[np.intp] | None = None
        # Of a column, to the right, after whole ones were copied.
        self._rest = 0.0
        self._samples = (1, 1)
        self._wraps = isinstance(camera, PanoramaCamera | EquirectangularCamera)
        if isinstance(camera, PanoramaCamera) and camera.mounting.is_upright:
            seen = self._tabulate_panorama(camera)
        else:
            seen = self._tabulate_directions(camera)
        if camera.mask is not None:
            seen = seen & self._unmasked(camera.mask.world)
        if not seen.any():
            raise CameraError(
                f"camera: images of {image_size[0]} x {image_size[1]} show no elevation of the panorama "
                f"[{geometry.elevation_bottom_deg:g}, {geometry.elevation_top_deg:g}] degrees; "
                f"check {_EXTENT_KEYS[camera.kind]}"
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
        return grey.astype(np.float32) if self._rest == 0.0 else _within(shifted(grey, self._rest), grey)

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
        return _within(fine, grey)

    def _tabulate_panorama(self, camera: PanoramaCamera) -> NDArray[np.bool_]:
        width, height = self.image_size
        source = geometry_of(camera, self.image_size)
        row_deg = (self.geometry.elevation_top_deg - self.geometry.elevation_bottom_deg) / self.geometry.height
        down = _samples(row_deg * height / (source.elevation_top_deg - source.elevation_bottom_deg))
        across = _samples(width / self.geometry.width)
        self._samples = (across, down)
        fine_columns, fine_rows = self._fine_grid()
        sense = 1.0 if camera.columns == "clockwise" else -1.0
        offset = fine_columns - (self.turn - camera.mounting.yaw) * self.geometry.width / (2.0 * np.pi)
        columns = np.mod(camera.heading_column + sense * offset * (width / self.geometry.width), width)
        rows = row_of_elevation(camera, height, self.geometry.elevation_of_row(fine_rows))
        seen_rows = np.asarray((rows > -0.5 - _WHOLE) & (rows < height - 0.5 + _WHOLE))
        if across * down == 1 and width == self.geometry.width and _are_whole(rows):
            whole = np.rint(columns[0])
            rest = sense * (whole - columns[0])
            self._rest = 0.0 if abs(rest) < _WHOLE else float(rest)
            self._columns = (whole + sense * fine_columns).astype(np.intp) % width
            self._rows = np.clip(np.rint(rows), 0, height - 1).astype(np.intp)
        else:
            self._set_maps(*np.meshgrid(columns + _SEAM, np.clip(np.nan_to_num(rows), 0, height - 1)))
        seen = np.asarray(seen_rows.reshape(-1, down).all(axis=1))
        return np.repeat(seen[:, None], self.geometry.width, axis=1)

    def _tabulate_directions(self, camera: AnyCamera) -> Bool:
        """Every pixel of the panorama is a direction, which the mount turns into the camera's frame."""
        self._samples = self._usual_samples(camera)
        across, down = self._samples
        pixels = self._pixels_of(camera, *self._fine_grid())
        u, v = pixels.u, pixels.v
        self._set_maps(np.nan_to_num(u + _SEAM * self._wraps, nan=-1.0), np.nan_to_num(v, nan=-1.0))
        by_pixel = pixels.seen.reshape(self.geometry.height, down, self.geometry.width, across)
        return np.asarray(by_pixel.all(axis=(1, 3)))

    def _pixels_of(self, camera: AnyCamera, columns: FloatArray, rows: FloatArray) -> Pixels:
        mount = camera.mounting
        elevation = self.geometry.elevation_of_row(rows)[:, None]
        azimuth = (self.geometry.azimuth_of_column(columns) + self.turn)[None, :]
        if mount.is_upright:
            pixels = pixels_of(camera, self.image_size, azimuth - mount.yaw, elevation)
        else:
            pixels = pixels_of(camera, self.image_size, *angles_of(rays_of(azimuth, elevation) @ mount.rotation))
        return Pixels(*np.broadcast_arrays(*pixels))

    def _usual_samples(self, camera: AnyCamera) -> tuple[int, int]:
        """How many pixels of the image a pixel of the panorama covers, across and down."""
        if isinstance(camera, OmniCamera) and camera.mounting.is_upright:
            inner, outer = camera.valid_radius_px
            elevations = self.geometry.elevation_of_row(np.arange(self.geometry.height))
            coarse = radius_px(camera.profile, elevations, camera.looks_up)
            used = coarse[(coarse >= inner) & (coarse <= outer)]
            largest, step = (np.max(used), np.max(np.abs(np.diff(used)), initial=1.0)) if used.size else (1.0, 1.0)
            return _samples(2.0 * np.pi * largest / self.geometry.width), _samples(step)
        pixels = self._pixels_of(
            camera, np.arange(self.geometry.width, dtype=np.float64), np.arange(self.geometry.height, dtype=np.float64)
        )
        u, v = (np.where(pixels.seen, part, np.nan) for part in (pixels.u, pixels.v))
        steps = []
        for axis in (1, 0):
            step = np.hypot(np.diff(u, axis=axis), np.diff(v, axis=axis))
            known = step[np.isfinite(step)]
            steps.append(_samples(float(np.quantile(known, _USUAL_STEP))) if known.size else 1)
        return steps[0], steps[1]

    def _unmasked(self, world: Bool) -> Bool:
        """Pixels of the panorama that are made of pixels of the world alone."""
        if self._rows is not None and self._columns is not None:
            copied = world[np.ix_(self._rows, self._columns)]
            # Between two columns, both count.
            return copied if self._rest == 0.0 else copied & np.roll(copied, int(np.sign(self._rest)), axis=1)
        levels = world.astype(np.uint8) * np.uint8(255)
        if self._wraps:
            levels = cv2.copyMakeBorder(levels, 0, 0, _SEAM, _SEAM, cv2.BORDER_WRAP)
        fine = cv2.remap(levels, self._map_1, self._map_2, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) > _WORLD_LEVEL
        across, down = self._samples
        return np.asarray(fine.reshape(self.geometry.height, down, self.geometry.width, across).all(axis=(1, 3)))

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


_EXTENT_KEYS = {
    "panorama": "elevation_deg",
    "omni": "elevation_deg, center_px, valid_radius_px and the lens's field",
    "equirectangular": "elevation_deg",
    "fisheye_pair": "field_deg and where front and back look",
}
_WORLD_LEVEL = 252  # of 255: less shows a pixel of the robot through the interpolation


def _check_size(camera: AnyCamera, image_size: tuple[int, int]) -> None:
    found = f"{image_size[0]} x {image_size[1]}"
    faults = []
    sizes = [("lens", camera.size_px)] if isinstance(camera, LensCamera) else []
    if isinstance(camera, FisheyePairCamera):
        whole = [(name, one) for name, one in (("front", camera.front), ("back", camera.back)) if one.offset_px == (0.0, 0.0)]
        sizes = [(name, one.size_px) for name, one in whole if one.size_px != (image_size[0] // 2, image_size[1])]
    for name, size in sizes:
        if size is not None and size != image_size:
            faults.append(f"{name} = calibrated for {size[0]} x {size[1]} pixels: images have {found}; calibrate at their size")
    if isinstance(camera, EquirectangularCamera) and image_size[0] != 2 * image_size[1]:
        faults.append(
            f"kind = equirectangular: images of {found} are not twice as wide as high; use kind: panorama with elevation_deg"
        )
    if camera.mask is not None and camera.mask.size != image_size:
        width, height = camera.mask.size
        faults.append(f"mask = {width} x {height} pixels: images have {found}; paint it on one of the images")
    if faults:
        raise CameraError(f"camera: {fault}" for fault in faults)


def _within(levels: NDArray[np.floating[Any]], grey: Image) -> NDArray[np.float32]:
    """Levels that an image can have: what is interpolated overshoots at edges."""
    clipped: NDArray[np.float32] = np.clip(levels, 0.0, 65535.0 if grey.dtype == np.uint16 else 255.0).astype(np.float32)
    return clipped


def _samples(shrink: float) -> int:
    """Sample points along an axis of a target pixel that covers ``shrink`` source pixels, against aliasing."""
    return int(np.clip(np.rint(shrink), 1, _MOST_SAMPLES))


def _are_whole(values: ArrayLike) -> bool:
    v = np.asarray(values)
    return bool(np.all(np.abs(v - np.rint(v)) < _WHOLE))


def _is_identity(index: NDArray[np.intp], size: int) -> bool:
    return len(index) == size and bool(index[0] == 0) and bool(np.all(np.diff(index) == 1))

"""Features of panoramas and of their views from elsewhere, for cameras that are still being searched for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import AnyCamera, Panorama, PanoramaGeometry, Unwrapper, geometry_of
from panoloc_mcl.robot.camera.directions import angles_of, pixels_of, rays_of
from panoloc_mcl.robot.eigenspace.gradients import orientations, pad_circular
from panoloc_mcl.robot.kernels.warping import warp_table
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.views import FloorRays

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

_MARGIN = 4
_SOFT_PX = 0.7
#: A search that begins far off needs many views, and half a degree is read off two-degree pixels easily. The last of it
#: needs finer ones: with them, and nearly twice the images, a mirror's centre came out to 0.07 instead of 0.5 pixels.
COARSE_COLUMNS, FINE_COLUMNS = 180, 360
# What a floor and a wall explain; ceilings and the robot's own feet are left out.
_BOTTOM_DEG, _TOP_DEG = -60.0, 30.0


@dataclass(frozen=True, eq=False)
class Features:
    """Smoothed local orientations.

    Parameters
    ----------
    z : complex64 (rows, columns)
    usable : bool (rows, columns)
    """

    z: Complex64
    usable: Bool


def geometry_for_calibration(camera: AnyCamera, image_size: tuple[int, int], most_columns: int) -> PanoramaGeometry:
    """The panorama to compare: no finer than needed, and only what a floor and walls show."""
    whole = geometry_of(camera, image_size)
    rows_a_degree = whole.height / (whole.elevation_top_deg - whole.elevation_bottom_deg)
    columns = whole.width
    while columns > most_columns and columns % 2 == 0:
        columns, rows_a_degree = columns // 2, rows_a_degree / 2.0
    bottom, top = max(whole.elevation_bottom_deg, _BOTTOM_DEG), min(whole.elevation_top_deg, _TOP_DEG)
    return PanoramaGeometry(columns, max(8, round((top - bottom) * rows_a_degree)), bottom, top)


def softened(image: NDArray[Any], camera: AnyCamera, geometry: PanoramaGeometry) -> NDArray[Any]:
    """A grey image without what the panorama cannot show: otherwise every fraction of a pixel would blur it differently."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY)
    shrink = max(1.0, geometry_of(camera, (image.shape[1], image.shape[0])).width / geometry.width)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), _SOFT_PX * shrink))


def unwrapped(camera: AnyCamera, image_size: tuple[int, int], geometry: PanoramaGeometry, images: list[Any]) -> list[Panorama]:
    """Panoramas of raw images, column 0 along the base's heading."""
    unwrap = Unwrapper(camera, image_size, geometry)
    return [unwrap(image) for image in images]


def features_of(panorama: Panorama, settings: VotesSettings, sigma_px: float) -> Features:
    """Orientations, smoothed so that they are alike over a few pixels."""
    z, usable = orientations(panorama, settings)
    return Features(_smoothed(z, sigma_px), usable)


def _smoothed(z: Complex64, sigma_px: float) -> Complex64:
    if sigma_px <= 0.0:
        return z
    # Two boxes of n pixels have the variance (n^2 - 1) / 6; they take the same time for any n.
    box = 2 * round(0.5 * (math.sqrt(6.0 * sigma_px**2 + 1.0) - 1.0)) + 1
    planes = np.stack([pad_circular(z.real, box), pad_circular(z.imag, box)], axis=-1).astype(np.float32)
    planes = cv2.blur(cv2.blur(planes, (box, box)), (box, box))[:, box:-box]
    return np.ascontiguousarray(planes).view(np.complex64)[..., 0]


def flow_of(
    camera: AnyCamera, sides: tuple[AnyCamera, AnyCamera], step: float, image_size: tuple[int, int], geometry: PanoramaGeometry
) -> Float64:
    """How the pixels of a panorama move when a camera is described otherwise.

    Parameters
    ----------
    camera : AnyCamera
        As it is described.
    sides : (AnyCamera, AnyCamera)
        After a step up and a step down.
    step : float
    image_size : (int, int)
    geometry : PanoramaGeometry

    Returns
    -------
    float64 (2, rows, columns)
        Columns and rows a unit: where, in the panorama of ``camera``, the content lies that the other description puts at a pixel.
    """
    here, up, down = (_pixel_map(one, image_size, geometry) for one in (camera, *sides))
    # Columns of a cylinder go on behind its seam.
    width = image_size[0]

    def apart(first: Float64, second: Float64) -> Float64:
        difference = first - second
        difference[0] -= width * np.round(difference[0] / width)
        return difference

    across = 0.5 * apart(np.roll(here, -1, axis=2), np.roll(here, 1, axis=2))
    along = np.empty_like(here)
    along[:, 1:-1] = 0.5 * apart(here[:, 2:], here[:, :-2])
    along[:, 0], along[:, -1] = along[:, 1], along[:, -2]
    moved = apart(up, down) / (2.0 * step)
    determinant = across[0] * along[1] - across[1] * along[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        flow = np.stack([along[1] * moved[0] - along[0] * moved[1], across[0] * moved[1] - across[1] * moved[0]]) / determinant
    usual = np.nanmedian(np.abs(flow), axis=(1, 2))
    # Where two lenses meet, and at poles, there is no derivative.
    wild = ~np.isfinite(flow).all(axis=0) | (np.abs(flow) > 20.0 * usual[:, None, None] + 1e-9).any(axis=0)
    flow[:, wild] = 0.0
    return np.asarray(flow)


def _pixel_map(camera: AnyCamera, image_size: tuple[int, int], geometry: PanoramaGeometry) -> Float64:
    """Pixels (u, v) of the camera's images that make up a panorama, float64 (2, rows, columns); NaN where not seen."""
    mount = camera.mounting
    azimuth = geometry.azimuth_of_column(np.arange(geometry.width, dtype=np.float64))[None, :]
    elevation = geometry.elevation_of_row(np.arange(geometry.height, dtype=np.float64))[:, None]
    found = pixels_of(camera, image_size, *angles_of(rays_of(azimuth, elevation) @ mount.rotation), bounded=False)
    u, v = np.broadcast_arrays(found.u, found.v)
    return np.stack([u, v]).astype(np.float64)


def slopes_of(z: Complex64) -> tuple[Complex64, Complex64]:
    """Derivatives of features along columns and rows, a pixel: over five points, as two would miss much of what is fine."""
    padded = np.pad(z, ((2, 2), (0, 0)), mode="edge")
    return _five_points(lambda k: np.roll(z, -k, axis=1)), _five_points(lambda k: padded[2 + k : 2 + k + z.shape[0]])


def _five_points(at: Callable[[int], Complex64]) -> Complex64:
    return np.asarray((8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / 12.0, dtype=np.complex64)


class Warp:
    """Views of one panorama from other places, with floors and walls.

    Parameters
    ----------
    geometry : PanoramaGeometry
    height_m : float
        Of the camera above the floor.
    """

    def __init__(self, geometry: PanoramaGeometry, height_m: float) -> None:
        self.rays = FloorRays.of(geometry, height_m)
        self._columns = geometry.width

    def view(self, source: Panorama, profile: Float64, apart: Float64) -> Panorama:
        """The source as seen from another pose.

        Parameters
        ----------
        source : Panorama
            Column 0 along its own heading.
        profile : float64 (columns,)
            Distance of the wall around the view, metres, column 0 along the view's heading.
        apart : float64 (3,)
            Pose of the source as seen from the view.
        """
        rays, columns = self.rays, self._columns
        map_x, map_y = warp_table(
            profile, rays.tangents, rays.floor, -float(apart[0]), -float(apart[1]), rays.top, rays.row_step, columns, _MARGIN
        )
        shift = float(apart[2]) * columns / (2.0 * np.pi)
        map_x = (np.mod(map_x - np.float32(_MARGIN) + np.float32(shift), np.float32(columns)) + np.float32(_MARGIN)).astype(
            np.float32
        )
        pixels = cv2.remap(
            pad_circular(source.pixels, _MARGIN), map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        seen = (map_y > -0.5) & (map_y < pixels.shape[0] - 0.5)
        if source.valid is not None:
            valid = pad_circular(source.valid.astype(np.float32), _MARGIN)
            seen &= cv2.remap(valid, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) > 0.99
        return Panorama(pixels * seen, seen)

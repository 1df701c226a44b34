"""The panorama that a camera's images carry by themselves: its size, and the elevations that it shows."""

from __future__ import annotations

import math

import numpy as np

from panoloc_mcl.robot.camera.lenses import widest_angle
from panoloc_mcl.robot.camera.panorama import PanoramaGeometry
from panoloc_mcl.robot.camera.spec import AnyCamera, EquirectangularCamera, FisheyePairCamera, LensCamera, PanoramaCamera

# More columns tell little more and take twice the time.
_MOST_COLUMNS, _FEWER_COLUMNS = 720, 360
_ROWS_A_DEGREE = 2


def geometry_of(camera: AnyCamera, image_size: tuple[int, int]) -> PanoramaGeometry:
    """The canonical panorama that a camera's images carry by themselves.

    Parameters
    ----------
    camera : AnyCamera
    image_size : (int, int)
        Width and height of its images; where the camera names the panorama's size itself, they do not matter.

    Raises
    ------
    CameraError
        Images too small to be a panorama.
    """
    if isinstance(camera, PanoramaCamera):
        return PanoramaGeometry(*image_size, *camera.elevation_deg)
    if isinstance(camera, EquirectangularCamera):
        bottom, top = camera.elevation_deg
        columns = min(image_size[0], _MOST_COLUMNS)
        size = camera.size or (columns, round((top - bottom) / 360.0 * columns))
        return PanoramaGeometry(*size, bottom, top)
    target = camera.panorama
    if target is not None:
        return PanoramaGeometry(*target.size, *target.elevation_deg)
    if isinstance(camera, LensCamera):
        return _of_lens(camera, image_size)
    assert isinstance(camera, FisheyePairCamera)
    pixels_a_degree = min(_pixels_a_degree(one.lens) for one in (camera.front, camera.back))
    return PanoramaGeometry(_columns(360.0 * pixels_a_degree), 180 * _ROWS_A_DEGREE, -90.0, 90.0)


def _columns(circumference_px: float) -> int:
    return _MOST_COLUMNS if circumference_px >= 1.5 * _MOST_COLUMNS else _FEWER_COLUMNS


def _pixels_a_degree(lens: object) -> float:
    """Of a lens, around its axis."""
    u, v = lens.project(np.array([[math.sin(math.radians(1.0)), 0.0, math.cos(math.radians(1.0))]]))  # type: ignore[attr-defined]
    return float(np.hypot(u - lens.cx, v - lens.cy)[0])  # type: ignore[attr-defined]


def _of_lens(camera: LensCamera, image_size: tuple[int, int]) -> PanoramaGeometry:
    """All that the lens shows within the image and the radii that may be used."""
    angles = np.linspace(0.0, widest_angle(camera.lens), 721)
    u, v = camera.lens.project(np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=-1))
    radii = np.hypot(u - camera.center_px[0], v - camera.center_px[1])
    (cx, cy), (width, height) = camera.center_px, image_size
    reach = max(cx, width - 1.0 - cx, cy, height - 1.0 - cy)
    inner, outer = camera.radii
    with np.errstate(invalid="ignore"):
        used = np.flatnonzero((radii >= inner) & (radii <= min(outer, reach)))
    first, last = (np.degrees(angles[used[[0, -1]]])) if used.size else (0.0, 180.0)
    bottom, top = (90.0 - last, 90.0 - first) if camera.looks_up else (first - 90.0, last - 90.0)
    rows = max(2, round((top - bottom) * _ROWS_A_DEGREE))
    circumference = 2.0 * math.pi * float(radii[used[-1]]) if used.size else 0.0
    return PanoramaGeometry(_columns(circumference), rows, max(float(bottom), -90.0), min(float(top), 90.0))

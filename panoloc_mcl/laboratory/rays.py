"""Which way points of a camera's images look, for every kind of camera: the inverse of `panoloc_mcl.robot.camera.directions`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera.directions import angles_of, heading_column_of, pixels_of
from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.camera.spec import AnyCamera, EquirectangularCamera, OmniCamera, PanoramaCamera

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

_PROFILE_STEPS = 36001
# Where no formula leads back: directions so far apart are tried, and the nearest one is refined by Newton's method.
_GRID_DEG = 1.0
_ROUNDS = 8
_PROBE = 1e-5  # radians
_EXACT_PX = 0.01
_MOST_STEP = 0.05  # radians


def directions_of(camera: AnyCamera, size: tuple[int, int], column: Float64, row: Float64) -> tuple[Float64, Float64, Bools]:
    """Azimuth (left positive) and elevation of points of an image, in the camera's own frame, radians, and where it shows anything.

    Parameters
    ----------
    camera : AnyCamera
    size : (int, int)
        Width and height of its images.
    column, row : float64, same shape
        Pixels; centres lie at integers.

    Returns
    -------
    azimuth, elevation : float64, same shape
        0 where nothing is shown.
    seen : bool, same shape
    """
    if isinstance(camera, PanoramaCamera | EquirectangularCamera):
        sense = -1.0 if camera.columns == "clockwise" else 1.0
        azimuth = sense * 2.0 * np.pi * (column - heading_column_of(camera, size)) / size[0]
        bottom, top = (-90.0, 90.0) if isinstance(camera, EquirectangularCamera) else camera.elevation_deg
        elevation = np.radians(top + (row + 0.5) * ((bottom - top) / size[1]))
        return _wrapped(azimuth), elevation, np.ones(column.shape, dtype=np.bool_)
    if isinstance(camera, OmniCamera):
        x, y = column - camera.center_px[0], camera.center_px[1] - row
        radius, angle = np.hypot(x, y), np.arctan2(y, x) - math.radians(camera.heading_angle_deg)
        elevation = _elevation_at(camera, radius)
        inner, outer = camera.valid_radius_px
        seen = (radius >= inner) & (radius <= outer) & np.isfinite(elevation)
        azimuth = _wrapped(angle if camera.azimuth == "counterclockwise" else -angle)
        return np.where(seen, azimuth, 0.0), np.where(seen, elevation, 0.0), seen
    return _searched(camera, size, column, row)


def _elevation_at(camera: OmniCamera, radius: Float64) -> Float64:
    """The profile turned round by a fine table; NaN where no elevation is imaged."""
    elevations = np.radians(np.linspace(-90.0, 90.0, _PROFILE_STEPS))
    radii = radius_px(camera.profile, elevations, camera.looks_up)
    known = np.isfinite(radii)
    r, e = radii[known], elevations[known]
    if r[-1] < r[0]:
        r, e = r[::-1], e[::-1]
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(r)) > 0.0])
    return np.asarray(np.interp(radius, r[rising], e[rising], left=np.nan, right=np.nan), dtype=np.float64)


def _searched(camera: AnyCamera, size: tuple[int, int], column: Float64, row: Float64) -> tuple[Float64, Float64, Bools]:
    """By search: for lenses whose formulas lead only from rays to pixels."""
    # Slow to import, and only these cameras need it.
    from scipy.spatial import cKDTree

    steps = np.radians(np.arange(-90.0, 90.0 + 0.5 * _GRID_DEG, _GRID_DEG))
    azimuths, elevations = np.meshgrid(np.radians(np.arange(0.0, 360.0, _GRID_DEG)), steps)
    u, v, seen = pixels_of(camera, size, azimuths, elevations)
    tree = cKDTree(np.column_stack([u[seen], v[seen]]))
    wanted = np.column_stack([column.ravel(), row.ravel()])
    nearest = tree.query(wanted)[1]
    rays = _rays(azimuths[seen][nearest], elevations[seen][nearest])
    for _ in range(_ROUNDS):
        across, along = _tangents(rays)
        off = wanted - _pixels(camera, size, rays)
        slopes = [
            (_pixels(camera, size, rays + _PROBE * t) - _pixels(camera, size, rays - _PROBE * t)) for t in (across, along)
        ]
        (a, c), (b, d) = (slope.T / (2.0 * _PROBE) for slope in slopes)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (d * off[:, 0] - b * off[:, 1]) / (a * d - b * c), (a * off[:, 1] - c * off[:, 0]) / (a * d - b * c)
        moved = [np.clip(np.nan_to_num(step), -_MOST_STEP, _MOST_STEP)[:, None] for step in (first, second)]
        rays = rays + moved[0] * across + moved[1] * along
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    azimuth, elevation = angles_of(rays)
    u, v, shown = pixels_of(camera, size, azimuth, elevation)
    with np.errstate(invalid="ignore"):
        found = shown & (np.hypot(u - wanted[:, 0], v - wanted[:, 1]) < _EXACT_PX)
    azimuth, elevation = np.where(found, azimuth, 0.0), np.where(found, elevation, 0.0)
    return azimuth.reshape(column.shape), elevation.reshape(column.shape), found.reshape(column.shape)


def _pixels(camera: AnyCamera, size: tuple[int, int], rays: Float64) -> Float64:
    u, v, _ = pixels_of(camera, size, *angles_of(rays))
    return np.column_stack([u, v])


def _rays(azimuth: Float64, elevation: Float64) -> Float64:
    level = np.cos(elevation)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def _tangents(rays: Float64) -> tuple[Float64, Float64]:
    """Two unit vectors (n, 3) at right angles to each ray and to each other."""
    helper = np.where(np.abs(rays[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(helper, rays)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return across, np.cross(rays, across)


def _wrapped(angle: Float64) -> Float64:
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)

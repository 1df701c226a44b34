"""From directions in a camera's own frame to pixels of its images.

Directions are azimuths (left positive) and elevations in radians, which broadcast against each other; the frame is x forward, y left,
z up. Pixels are (u, v), u to the right and v down, centres at integers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera.lenses import widest_angle
from panoloc_mcl.robot.camera.mount import rotation
from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.camera.spec import (
    AnyCamera,
    EquirectangularCamera,
    Fisheye,
    FisheyePairCamera,
    LensCamera,
    OmniCamera,
    PanoramaCamera,
)

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_WHOLE = 1e-6  # pixels


class Pixels(NamedTuple):
    """Where directions appear.

    Parameters
    ----------
    u, v : float64
        Pixels; anything where not seen.
    seen : bool, same shape
        Directions that the camera shows. Those within half a pixel of the image's rim are.
    """

    u: Float64
    v: Float64
    seen: Bool


def rays_of(azimuth: Float64, elevation: Float64) -> Float64:
    """Unit vectors (..., 3)."""
    level = np.cos(elevation)
    return np.stack(np.broadcast_arrays(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)), axis=-1)


def angles_of(rays: Float64) -> tuple[Float64, Float64]:
    """Azimuth and elevation of rays (..., 3) of any length."""
    x, y, z = np.moveaxis(rays, -1, 0)
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))


def pixels_of(
    camera: AnyCamera, image_size: tuple[int, int], azimuth: Float64, elevation: Float64, *, bounded: bool = True
) -> Pixels:
    """Pixels that look along directions of the camera's own frame.

    Parameters
    ----------
    camera : AnyCamera
    image_size : (int, int)
        Width and height.
    azimuth, elevation : float64
        Radians.
    bounded : bool
        Rows of cylinders end with the image; otherwise they go on beyond it.
    """
    if isinstance(camera, OmniCamera):
        return _omni(camera, image_size, azimuth, elevation)
    if isinstance(camera, LensCamera):
        return _lens(camera, image_size, azimuth, elevation)
    if isinstance(camera, FisheyePairCamera):
        return _fisheye_pair(camera, image_size, rays_of(azimuth, elevation))
    found = _cylinder(camera, image_size, azimuth, elevation)
    return found._replace(v=np.clip(found.v, 0.0, image_size[1] - 1.0)) if bounded else found


def heading_column_of(camera: PanoramaCamera | EquirectangularCamera, image_size: tuple[int, int]) -> float:
    """The column that looks ahead; of a full sphere the middle, between two columns, unless it says otherwise."""
    return 0.5 * (image_size[0] - 1) if camera.heading_column is None else camera.heading_column


def row_of_elevation(camera: PanoramaCamera, height: int, elevation: Float64) -> Float64:
    """The row of a panorama's image, of so many rows, that looks at elevations in radians; NaN where it has none."""
    bottom, top = np.radians(camera.elevation_deg)
    share = (elevation - top) / (bottom - top)
    if camera.rows is not None and camera.rows != "elevation":
        first, last = radius_px(camera.rows, np.array([top, bottom]))
        share = (radius_px(camera.rows, elevation) - first) / (last - first)
    return np.asarray(share * height - 0.5)


def _cylinder(
    camera: PanoramaCamera | EquirectangularCamera, image_size: tuple[int, int], azimuth: Float64, elevation: Float64
) -> Pixels:
    width, height = image_size
    sphere = isinstance(camera, EquirectangularCamera)
    bottom, top = np.radians((-90.0, 90.0) if sphere else camera.elevation_deg)
    sense = -1.0 if camera.columns == "clockwise" else 1.0
    u = np.mod(heading_column_of(camera, image_size) + sense * azimuth * (width / (2.0 * np.pi)), width)
    if isinstance(camera, PanoramaCamera):
        v = row_of_elevation(camera, height, elevation)
    else:
        v = (elevation - top) * (height / (bottom - top)) - 0.5
    u, v = np.broadcast_arrays(u, v)
    if sphere:
        low, high = np.radians(camera.elevation_deg)
        seen = (elevation >= low - _WHOLE) & (elevation <= high + _WHOLE)
    else:
        seen = (v > -0.5 - _WHOLE) & (v < height - 0.5 + _WHOLE)
    return Pixels(u, v, np.broadcast_to(seen, u.shape))


def _image_angle(camera: OmniCamera | LensCamera, azimuth: Float64) -> Float64:
    sense = 1.0 if camera.azimuth == "counterclockwise" else -1.0
    return math.radians(camera.heading_angle_deg) + sense * azimuth


def _omni(camera: OmniCamera, image_size: tuple[int, int], azimuth: Float64, elevation: Float64) -> Pixels:
    inner, outer = camera.valid_radius_px
    angle = _image_angle(camera, azimuth)
    radius = radius_px(camera.profile, elevation, camera.looks_up)
    # v points down while angles in the image count up from +u towards the top.
    u, v = camera.center_px[0] + radius * np.cos(angle), camera.center_px[1] - radius * np.sin(angle)
    with np.errstate(invalid="ignore"):
        seen = (radius >= inner - _WHOLE) & (radius <= outer + _WHOLE) & _inside(u, v, image_size)
    return Pixels(u, v, np.asarray(seen))


def _lens(camera: LensCamera, image_size: tuple[int, int], azimuth: Float64, elevation: Float64) -> Pixels:
    inner, outer = camera.radii
    angle = _image_angle(camera, azimuth)
    level, along = np.cos(elevation), np.sin(elevation) if camera.looks_up else -np.sin(elevation)
    u, v = camera.lens.project(np.stack(np.broadcast_arrays(level * np.cos(angle), -level * np.sin(angle), along), axis=-1))
    in_field = np.arccos(np.clip(along, -1.0, 1.0)) <= widest_angle(camera.lens)
    radius = np.hypot(u - camera.center_px[0], v - camera.center_px[1])
    with np.errstate(invalid="ignore"):
        seen = in_field & (radius >= inner - _WHOLE) & (radius <= outer + _WHOLE) & _inside(u, v, image_size)
    return Pixels(u, v, np.asarray(seen))


def _fisheye_pair(camera: FisheyePairCamera, image_size: tuple[int, int], rays: Float64) -> Pixels:
    (u, v, angle), (u_back, v_back, angle_back) = (_through(one, rays) for one in (camera.front, camera.back))
    front = angle <= angle_back
    u, v, nearer = np.where(front, u, u_back), np.where(front, v, v_back), np.minimum(angle, angle_back)
    limits = [min(math.radians(0.5 * one.field_deg), widest_angle(one.lens)) for one in (camera.front, camera.back)]
    with np.errstate(invalid="ignore"):
        seen = (nearer <= np.where(front, *limits)) & _inside(u, v, image_size)
    # Half of the strip lies on either side of the joint, where both angles are equal.
    seen &= np.abs(angle - angle_back) >= math.radians(camera.seam_deg)
    return Pixels(u, v, np.asarray(seen))


def _through(one: Fisheye, rays: Float64) -> tuple[Float64, Float64, Float64]:
    """Pixels of the joint image, and the angle from the axis."""
    ahead, left, up = np.moveaxis(rays @ rotation(one.yaw_deg, one.pitch_deg, one.roll_deg), -1, 0)
    u, v = one.lens.project(np.stack([-left, -up, ahead], axis=-1))
    return u + one.offset_px[0], v + one.offset_px[1], np.arccos(np.clip(ahead, -1.0, 1.0))


def _inside(u: Float64, v: Float64, image_size: tuple[int, int]) -> Bool:
    width, height = image_size
    return np.asarray((u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5))

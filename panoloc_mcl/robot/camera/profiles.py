"""Radial profiles: how far from the centre of an omnidirectional image a direction of given elevation appears.

``t`` is the angle from the nadir (straight down): 90 degrees + elevation. A radius is NaN where the profile is not defined.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Discriminator, Field, Tag

from panoloc_mcl.robot.errors import CameraError
from panoloc_mcl.robot.settings.validation import StrictModel, kind_tag

FloatArray = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0.0)]
Point = tuple[float, float]


def _monotone_points(value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    points = np.asarray(value, dtype=np.float64)
    steps = np.diff(points, axis=0)
    if np.any(np.abs(points[:, 0]) > 90.0) or np.any(points[:, 1] < 0.0):
        raise ValueError("must be [elevation_deg, radius_px] with elevations in -90..90 and radii of 0 or more")
    if any(not (np.all(steps[:, axis] > 0.0) or np.all(steps[:, axis] < 0.0)) for axis in (0, 1)):
        raise ValueError("elevations and radii must each keep rising or keep falling from point to point; sort the points")
    return value


class UnifiedProfile(StrictModel):
    """Unified (sphere) model ``r = focal_px sin t / (xi + cos t)``, ``t`` = 90 degrees + elevation (from the nadir)."""

    kind: Literal["unified"] = "unified"
    xi: Annotated[float, Field(ge=0.0)]
    focal_px: Positive


class HyperbolicProfile(StrictModel):
    """Hyperbolic mirror: its eccentricity (> 1) and the focal length of the camera in its outer focus, in pixels."""

    kind: Literal["hyperbolic"] = "hyperbolic"
    eccentricity: Annotated[float, Field(gt=1.0)]
    focal_px: Positive


class EquiangularProfile(StrictModel):
    """Radius proportional to the angle from the nadir: ``r = focal_px t``, ``t`` in radians (a fisheye that looks down)."""

    kind: Literal["equiangular"] = "equiangular"
    focal_px: Positive


class LinearProfile(StrictModel):
    """Radius linear in elevation, through two given points ``[elevation_deg, radius_px]``; it may also fall."""

    kind: Literal["linear"] = "linear"
    points: Annotated[tuple[Point, Point], AfterValidator(_monotone_points)]


class TableProfile(StrictModel):
    """Measured points ``[elevation_deg, radius_px]``, both monotone, joined by a monotone cubic; nothing seen beyond."""

    kind: Literal["table"] = "table"
    points: Annotated[tuple[Point, ...], Field(min_length=2), AfterValidator(_monotone_points)]


Profile = Annotated[
    Annotated[UnifiedProfile, Tag("Unified")]
    | Annotated[LinearProfile, Tag("Linear")]
    | Annotated[EquiangularProfile, Tag("Equiangular")]
    | Annotated[HyperbolicProfile, Tag("Hyperbolic")]
    | Annotated[TableProfile, Tag("Table")],
    Discriminator(
        kind_tag,
        custom_error_type="profile_kind",
        custom_error_message="kind must be 'unified', 'linear', 'equiangular', 'hyperbolic' or 'table'",
    ),
]


def unified_radius(angle: ArrayLike, xi: float, focal_px: float) -> FloatArray:
    """Unified (sphere) model ``focal_px * sin t / (xi + cos t)``.

    Parameters
    ----------
    angle : array_like of float
        ``t``, radians from the nadir.
    xi : float
        Distance of the projection centre from the sphere's centre; 0 pinhole, 1 parabolic mirror.
    focal_px : float

    Returns
    -------
    ndarray of float64
        Pixels; NaN where the direction has no image, or where the radius no longer grows with ``t``.
    """
    t = np.asarray(angle, dtype=np.float64)
    cosine = np.cos(t)
    depth = xi + cosine
    # Past cos t = -1/xi the image folds back on itself.
    seen = (depth > 1e-9) & (1.0 + xi * cosine > 0.0) & (t >= 0.0)
    return np.where(seen, focal_px * np.sin(t) / np.where(seen, depth, 1.0), np.nan)


def hyperbolic_radius(angle: ArrayLike, eccentricity: float, focal_px: float) -> FloatArray:
    """Hyperbolic mirror seen by a pinhole camera in its outer focus.

    Equivalent to the unified model with ``xi = 2 e / (1 + e^2)`` and focal length ``focal_px (e^2 - 1) / (e^2 + 1)``.
    Parameters and result as in :func:`unified_radius`.
    """
    square = eccentricity * eccentricity
    return unified_radius(angle, 2.0 * eccentricity / (1.0 + square), focal_px * (square - 1.0) / (square + 1.0))


def table_radius(elevation: ArrayLike, points_deg: ArrayLike) -> FloatArray:
    """Monotone cubic interpolation of measured ``[elevation_deg, radius_px]`` points; NaN outside their elevations.

    Parameters
    ----------
    elevation : array_like of float
        Radians above the horizon.
    points_deg : array_like of float, shape (n, 2)
        Elevation in degrees, strictly increasing or strictly decreasing; radius in pixels.
    """
    # Slow to import, and only tables need it.
    from scipy.interpolate import PchipInterpolator

    points = np.asarray(points_deg, dtype=np.float64)
    points = points[np.argsort(points[:, 0])]
    wanted = np.degrees(np.asarray(elevation, dtype=np.float64))
    # A panorama whose edge is the table's end must not lose its edge row to rounding.
    inside = (wanted >= points[0, 0] - 1e-9) & (wanted <= points[-1, 0] + 1e-9)
    clipped = np.clip(wanted, points[0, 0], points[-1, 0])
    return np.where(inside, PchipInterpolator(points[:, 0], points[:, 1])(clipped), np.nan)


def radius_px(profile: Profile, elevation: ArrayLike, looks_up: bool = False) -> FloatArray:
    """Image radius of directions under any profile.

    Parameters
    ----------
    profile : Profile
    elevation : array_like of float
        Radians above the horizon, any shape.
    looks_up : bool
        The optical axis points to the zenith: ``t`` is the angle from there. Profiles of elevations say so themselves.

    Returns
    -------
    ndarray of float64, same shape
        Pixels from the centre; NaN where the profile has no image of that elevation.

    Raises
    ------
    CameraError
        A profile kind without a formula.
    """
    e = np.asarray(elevation, dtype=np.float64)
    t = 0.5 * np.pi - e if looks_up else e + 0.5 * np.pi
    if profile.kind == "unified":
        return unified_radius(t, profile.xi, profile.focal_px)
    if profile.kind == "hyperbolic":
        return hyperbolic_radius(t, profile.eccentricity, profile.focal_px)
    if profile.kind == "equiangular":
        return profile.focal_px * t
    if profile.kind == "linear":
        (e0, r0), (e1, r1) = profile.points
        radius = r0 + (np.degrees(e) - e0) * ((r1 - r0) / (e1 - e0))
        return np.where(radius >= 0.0, radius, np.nan)
    if profile.kind == "table":
        return table_radius(e, profile.points)
    raise CameraError(f"camera.profile.kind = {profile.kind!r}: has no formula")

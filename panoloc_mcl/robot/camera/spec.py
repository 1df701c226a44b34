"""The ``camera:`` mapping of a data set, read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import StrictModel, validate

Direction = Literal["clockwise", "counterclockwise"]
Positive = Annotated[float, Field(gt=0.0)]


def _ordered_elevations(value: tuple[float, float]) -> tuple[float, float]:
    if not -90.0 <= value[0] < value[1] <= 90.0:
        raise ValueError("must be [bottom, top] with -90 <= bottom < top <= 90")
    return value


def _ordered_radii(value: tuple[float, float]) -> tuple[float, float]:
    if not 0.0 <= value[0] < value[1]:
        raise ValueError("must be [inner, outer] with 0 <= inner < outer")
    return value


def _monotone_points(value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    points = np.asarray(value, dtype=np.float64)
    steps = np.diff(points, axis=0)
    if np.any(np.abs(points[:, 0]) > 90.0) or np.any(points[:, 1] < 0.0):
        raise ValueError("must be [elevation_deg, radius_px] with elevations in -90..90 and radii of 0 or more")
    if any(not (np.all(steps[:, axis] > 0.0) or np.all(steps[:, axis] < 0.0)) for axis in (0, 1)):
        raise ValueError("elevations and radii must each keep rising or keep falling from point to point; sort the points")
    return value


Elevations = Annotated[tuple[float, float], AfterValidator(_ordered_elevations)]
Point = tuple[float, float]


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


def _kind_tag(value: Any) -> str | None:
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    # Capitalised: the checker takes capitalised parts of a key for names of alternatives and leaves them out of the fault.
    return kind.capitalize() if isinstance(kind, str) and kind.islower() else None


Profile = Annotated[
    Annotated[UnifiedProfile, Tag("Unified")]
    | Annotated[LinearProfile, Tag("Linear")]
    | Annotated[EquiangularProfile, Tag("Equiangular")]
    | Annotated[HyperbolicProfile, Tag("Hyperbolic")]
    | Annotated[TableProfile, Tag("Table")],
    Discriminator(
        _kind_tag,
        custom_error_type="profile_kind",
        custom_error_message="kind must be 'unified', 'linear', 'equiangular', 'hyperbolic' or 'table'",
    ),
]


class PanoramaTarget(StrictModel):
    """The panorama to make of an omnidirectional image.

    ``columns`` and ``heading_column`` say how others lay that panorama out; this package always makes the canonical one
    (clockwise, column 0 ahead) of the same size and elevations.
    """

    size: tuple[Annotated[int, Field(ge=4, le=16384)], Annotated[int, Field(ge=2, le=16384)]]
    elevation_deg: Elevations
    columns: Direction = "clockwise"
    heading_column: float = 0.0


class PanoramaCamera(StrictModel):
    """Images that are unwrapped cylinders already, rows linear in elevation."""

    kind: Literal["panorama"] = "panorama"
    columns: Direction = "clockwise"
    heading_column: float = 0.0
    elevation_deg: Elevations
    height_m: Positive | None = None


class OmniCamera(StrictModel):
    """Raw images of a mirror or fisheye camera with a vertical axis."""

    kind: Literal["omni"] = "omni"
    center_px: Point
    valid_radius_px: Annotated[tuple[float, float], AfterValidator(_ordered_radii)]
    heading_angle_deg: float = 90.0
    azimuth: Direction = "counterclockwise"
    profile: Profile
    panorama: PanoramaTarget
    height_m: Positive | None = None

    @model_validator(mode="after")
    def _sees_its_panorama(self) -> OmniCamera:
        inner, outer = self.valid_radius_px
        radius = radius_px(self.profile, np.radians(np.linspace(*self.panorama.elevation_deg, 181)))
        if not np.any((radius >= inner) & (radius <= outer)):
            raise ValueError(
                f"the profile puts no elevation of panorama.elevation_deg {list(self.panorama.elevation_deg)} into "
                f"valid_radius_px [{inner:g}, {outer:g}]; check profile, elevations and radii"
            )
        return self


Camera = Annotated[
    Annotated[PanoramaCamera, Tag("Panorama")] | Annotated[OmniCamera, Tag("Omni")],
    Discriminator(_kind_tag, custom_error_type="camera_kind", custom_error_message="kind must be 'panorama' or 'omni'"),
]


_KINDS: dict[str, type[PanoramaCamera] | type[OmniCamera]] = {"panorama": PanoramaCamera, "omni": OmniCamera}


def camera_from_mapping(data: Mapping[str, Any], source: str) -> PanoramaCamera | OmniCamera:
    """Check a camera mapping.

    Parameters
    ----------
    data : mapping
        As under ``camera:`` in a data set, or the whole of a ``camera.yaml``.
    source : str
        What to call it in a fault, usually the file.

    Raises
    ------
    CameraError
        Every fault, one line each: source, key, value and remedy.
    """
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise CameraError(f"{source}: kind = {kind!r}: must be 'panorama' or 'omni'")
    try:
        return validate(_KINDS[kind], data, source)
    except ConfigError as error:
        raise CameraError(error.faults) from error


def to_mapping(camera: PanoramaCamera | OmniCamera) -> dict[str, Any]:
    """Plain data for YAML that :func:`camera_from_mapping` reads back to an equal camera."""
    return camera.model_dump(mode="json", exclude_none=True)

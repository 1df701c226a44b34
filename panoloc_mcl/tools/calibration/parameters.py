"""What can be wrong with a camera's description, as numbers that a search may turn."""

from __future__ import annotations

import math
from typing import Any

from panoloc_mcl.robot.camera import (
    AnyCamera,
    EquirectangularCamera,
    FisheyePairCamera,
    LensCamera,
    LinearProfile,
    OmniCamera,
    PanoramaCamera,
    TableProfile,
)
from panoloc_mcl.robot.map.camera_search.parameters import Parameter, of_mount, of_tilt

ELEVATION_SCALE = "elevation scale"


def parameters_by_references(camera: AnyCamera, *, placed: bool, place_sd_m: float = 0.0) -> list[Parameter]:
    """What may be estimated of the camera that took the references, by their agreement with each other.

    Not the scale of elevations: floors and walls look the same to a camera that stands higher in proportion.

    Parameters
    ----------
    camera : AnyCamera
        As it is described.
    placed : bool
        Whether poses are the base's, so that the camera's place on it matters.
    place_sd_m : float
        What errors of the survey make of that place, metres (`ReferencesScene.place_sd_m`).
    """
    mount = camera.mounting
    found = [one for one in _of_optics(camera) if one.name != ELEVATION_SCALE]
    if camera.height_m is not None:
        found.append(
            Parameter(
                "height", "m", camera.height_m, 0.015 * camera.height_m, 0.3 * camera.height_m, 0.01 * camera.height_m, _height
            )
        )
    found += of_tilt(mount)
    if placed:
        accuracy = math.hypot(0.001, place_sd_m)
        found.append(of_mount("yaw", "deg", mount.yaw_deg, 1.0, 40.0, 0.03, "yaw_deg"))
        found.append(of_mount("forward", "m", mount.x_m, 0.01, 0.4, accuracy, "x_m"))
        found.append(of_mount("left", "m", mount.y_m, 0.01, 0.4, accuracy, "y_m"))
    return found


def parameters_by_map(camera: AnyCamera) -> list[Parameter]:
    """What may be estimated of another camera by a map: its optics and its tilt."""
    return [*_of_optics(camera, shift_accuracy_deg=0.05), *of_tilt(camera.mounting)]


def _of_optics(camera: AnyCamera, shift_accuracy_deg: float = 0.2) -> list[Parameter]:
    if isinstance(camera, PanoramaCamera):
        return [
            Parameter(ELEVATION_SCALE, "", 1.0, 0.01, 0.2, 0.002, _elevation_scale),
            Parameter("elevation shift", "deg", 0.0, 0.3, 8.0, shift_accuracy_deg, _elevation_shift),
        ]
    if isinstance(camera, OmniCamera):
        u, v = camera.center_px
        return [
            Parameter("centre u", "px", u, 0.5, 15.0, 0.1, lambda c, value: _center(c, u=value)),
            Parameter("centre v", "px", v, 0.5, 15.0, 0.1, lambda c, value: _center(c, v=value)),
            Parameter("focal scale", "", 1.0, 0.005, 0.2, 0.002, _focal),
        ]
    if isinstance(camera, LensCamera):
        u, v = camera.center_px
        return [
            Parameter("centre u", "px", u, 0.5, 15.0, 0.1, lambda c, value: _lens(c, cx=value)),
            Parameter("centre v", "px", v, 0.5, 15.0, 0.1, lambda c, value: _lens(c, cy=value)),
            Parameter("focal scale", "", 1.0, 0.005, 0.2, 0.002, _lens_focal),
        ]
    assert isinstance(camera, EquirectangularCamera | FisheyePairCamera)
    return []


def _height(camera: AnyCamera, value: float) -> AnyCamera:
    return camera.model_copy(update={"height_m": value})


def _elevation_scale(camera: AnyCamera, value: float) -> AnyCamera:
    assert isinstance(camera, PanoramaCamera)
    bottom, top = camera.elevation_deg
    return camera.model_copy(update={"elevation_deg": (value * bottom, value * top)})


def _elevation_shift(camera: AnyCamera, value: float) -> AnyCamera:
    assert isinstance(camera, PanoramaCamera)
    bottom, top = camera.elevation_deg
    return camera.model_copy(update={"elevation_deg": (max(bottom + value, -90.0), min(top + value, 90.0))})


def _center(camera: AnyCamera, u: float | None = None, v: float | None = None) -> AnyCamera:
    assert isinstance(camera, OmniCamera)
    old_u, old_v = camera.center_px
    return camera.model_copy(update={"center_px": (old_u if u is None else u, old_v if v is None else v)})


def with_focal_scale(camera: OmniCamera, value: float) -> OmniCamera:
    """The camera with all radii of its profile times a factor; the part of the image in use stays."""
    profile = camera.profile
    if isinstance(profile, LinearProfile | TableProfile):
        update: dict[str, Any] = {"points": tuple((elevation, radius * value) for elevation, radius in profile.points)}
    else:
        update = {"focal_px": profile.focal_px * value}
    return camera.model_copy(update={"profile": profile.model_copy(update=update)})


def _focal(camera: AnyCamera, value: float) -> AnyCamera:
    assert isinstance(camera, OmniCamera)
    return with_focal_scale(camera, value)


def _lens(camera: AnyCamera, **values: float) -> AnyCamera:
    assert isinstance(camera, LensCamera)
    return camera.model_copy(update={"lens": camera.lens.model_copy(update=values)})


def _lens_focal(camera: AnyCamera, value: float) -> AnyCamera:
    assert isinstance(camera, LensCamera)
    lens = camera.lens
    if lens.kind == "ocam":
        inverse = tuple(coefficient * value for coefficient in lens.inverse)
        return camera.model_copy(update={"lens": lens.model_copy(update={"inverse": inverse})})
    return _lens(camera, fx=lens.fx * value, fy=lens.fy * value)


def shown(value: float, unit: str) -> str:
    """A value with as many digits as its unit deserves."""
    digits = {"m": 4, "deg": 3, "px": 2, "s": 3}.get(unit, 4)
    return "-" if not math.isfinite(value) else f"{value:.{digits}f}"

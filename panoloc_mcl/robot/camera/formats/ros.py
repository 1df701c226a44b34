"""YAML of ROS's ``camera_info`` (``sensor_msgs/CameraInfo``) with ``equidistant`` or ``fisheye`` distortion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoloc_mcl.robot.camera.formats.calibration import Calibration, numbers_of, size_of
from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import parse_yaml


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    if "distortion_model:" not in text or "camera_model:" in text or text.startswith("%YAML:1.0"):
        return None
    try:
        data = parse_yaml(text, source)
    except ConfigError as error:
        raise CameraError(error.faults) from error
    model = str(data.get("distortion_model"))
    if model not in ("equidistant", "fisheye"):
        raise CameraError(f"{source}: distortion_model = {model}: is no panorama's; calibrate with equidistant (fisheye)")
    matrix, distortion = (
        _flat(data, *names, source=source) for names in (("camera_matrix", "K", "k"), ("distortion_coefficients", "D", "d"))
    )
    fx, _, cx, _, fy, cy, *_ = numbers_of({"camera_matrix": matrix}, "camera_matrix", 9, source)
    k = numbers_of({"distortion_coefficients": distortion}, "distortion_coefficients", 4, source)
    size = size_of(data.get("image_width", data.get("width")), data.get("image_height", data.get("height")), source)
    return Calibration("ROS camera_info", {"kind": "kannala_brandt", "fx": fx, "fy": fy, "cx": cx, "cy": cy, "k": k}, size)


def _flat(data: Mapping[str, Any], *names: str, source: str) -> Any:
    """Numbers of a matrix by any of its names: a list, or rows, columns and data."""
    for name in names:
        value = data.get(name)
        if value is not None:
            return value.get("data") if isinstance(value, Mapping) else value
    raise CameraError(f"{source}: key '{names[0]}' is missing; calibrate again or add it")

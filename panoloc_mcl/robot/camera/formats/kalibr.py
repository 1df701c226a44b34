"""Kalibr's ``camchain.yaml``: ``omni``, ``eucm``, ``ds`` and ``pinhole`` with ``equidistant`` distortion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoloc_mcl.robot.camera.formats.calibration import Calibration, numbers_of, size_of
from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import parse_yaml


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    if "camera_model:" not in text or "intrinsics:" not in text or text.startswith("%YAML:1.0"):
        return None
    try:
        chain = parse_yaml(text, source)
    except ConfigError as error:
        raise CameraError(error.faults) from error
    cameras = {key: value for key, value in chain.items() if isinstance(value, Mapping) and "camera_model" in value}
    if "camera_model" in chain:
        cameras = {"cam0": chain}
    name = next(iter(cameras), "cam0") if camera is None else (f"cam{camera}" if isinstance(camera, int) else camera)
    if name not in cameras:
        raise CameraError(f"{source}: camera_name = {name}: there are {', '.join(cameras) or 'none'}; name one of these")
    return _camera(cameras[name], f"{source}: {name}")


def _camera(data: Mapping[str, Any], source: str) -> Calibration:
    model, distortion = str(data["camera_model"]), str(data.get("distortion_model", "none"))
    width, height = numbers_of(data, "resolution", 2, source)
    size = size_of(width, height, source)
    if model == "omni" and distortion in ("radtan", "none"):
        xi, fx, fy, cx, cy = numbers_of(data, "intrinsics", 5, source)
        k1, k2, p1, p2 = numbers_of(data, "distortion_coeffs", 4, source) if distortion == "radtan" else (0.0,) * 4
        lens = {"kind": "mei", "xi": xi, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "k": [k1, k2], "p": [p1, p2]}
    elif model == "eucm" and distortion == "none":
        alpha, beta, fx, fy, cx, cy = numbers_of(data, "intrinsics", 6, source)
        lens = {"kind": "eucm", "alpha": alpha, "beta": beta, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    elif model == "ds" and distortion == "none":
        xi, alpha, fx, fy, cx, cy = numbers_of(data, "intrinsics", 6, source)
        lens = {"kind": "double_sphere", "xi": xi, "alpha": alpha, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    elif model == "pinhole" and distortion in ("equidistant", "equi"):
        fx, fy, cx, cy = numbers_of(data, "intrinsics", 4, source)
        k = numbers_of(data, "distortion_coeffs", 4, source)
        lens = {"kind": "kannala_brandt", "fx": fx, "fy": fy, "cx": cx, "cy": cy, "k": k}
    else:
        raise CameraError(
            f"{source}: camera_model = {model} with distortion_model = {distortion}: is no panorama's; calibrate with omni-radtan, "
            "eucm-none, ds-none or pinhole-equi"
        )
    return Calibration("Kalibr", lens, size)

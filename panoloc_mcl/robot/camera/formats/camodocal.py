"""YAML of CamOdoCal and its kin (VINS-Mono, VINS-Fusion): ``model_type`` MEI, KANNALA_BRANDT or SCARAMUZZA."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoloc_mcl.robot.camera.formats.calibration import Calibration, number_of, size_of
from panoloc_mcl.robot.camera.formats.opencv_yaml import parse_opencv
from panoloc_mcl.robot.errors import CameraError


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    if "model_type:" not in text:
        return None
    data = parse_opencv(text, source)
    model = str(data.get("model_type", "")).upper()
    if model not in _LENSES:
        known = ", ".join(_LENSES)
        raise CameraError(f"{source}: model_type = {data.get('model_type')!r}: is no panorama's; calibrate with one of {known}")
    lens = _LENSES[model](data, source)
    return Calibration("CamOdoCal", lens, size_of(data.get("image_width"), data.get("image_height"), source))


def _part(data: Mapping[str, Any], name: str, source: str) -> Mapping[str, Any]:
    part = data.get(name)
    if not isinstance(part, Mapping):
        raise CameraError(f"{source}: key '{name}' is missing; calibrate again or add it")
    return part


def _numbers(data: Mapping[str, Any], part: str, names: tuple[str, ...], source: str) -> list[float]:
    values = _part(data, part, source)
    return [number_of(values, name, f"{source}: {part}") for name in names]


def _mei(data: Mapping[str, Any], source: str) -> dict[str, Any]:
    (xi,) = _numbers(data, "mirror_parameters", ("xi",), source)
    k1, k2, p1, p2 = _numbers(data, "distortion_parameters", ("k1", "k2", "p1", "p2"), source)
    fx, fy, cx, cy = _numbers(data, "projection_parameters", ("gamma1", "gamma2", "u0", "v0"), source)
    return {"kind": "mei", "xi": xi, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "k": [k1, k2], "p": [p1, p2]}


def _kannala_brandt(data: Mapping[str, Any], source: str) -> dict[str, Any]:
    names = ("k2", "k3", "k4", "k5", "mu", "mv", "u0", "v0")
    *k, fx, fy, cx, cy = _numbers(data, "projection_parameters", names, source)
    return {"kind": "kannala_brandt", "fx": fx, "fy": fy, "cx": cx, "cy": cy, "k": k}


def _scaramuzza(data: Mapping[str, Any], source: str) -> dict[str, Any]:
    inverse = _part(data, "inv_poly_parameters", source)
    names = sorted((name for name in inverse if name[1:].isdigit()), key=lambda name: int(name[1:]))
    c, d, e, cx, cy = _numbers(data, "affine_parameters", ("ac", "ad", "ae", "cx", "cy"), source)
    coefficients = [number_of(inverse, name, source) for name in names]
    # Other than in OCamCalib's own files, x runs along the columns and z out of the camera.
    return {"kind": "ocam", "inverse": coefficients, "cx": cx, "cy": cy, "affine": [c, d, e, 1.0]}


_LENSES = {"MEI": _mei, "KANNALA_BRANDT": _kannala_brandt, "SCARAMUZZA": _scaramuzza}

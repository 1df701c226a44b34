"""Kalibr's ``camchain.yaml``: ``omni``, ``eucm``, ``ds`` and ``pinhole`` with ``equidistant`` distortion."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera.formats.calibration import Calibration, numbers_of, size_of
from panoloc_mcl.robot.camera.mount import OPTICAL, angles_deg, rotation
from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import parse_yaml


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    cameras = _cameras(text, source)
    if cameras is None:
        return None
    name = next(iter(cameras), "cam0") if camera is None else (f"cam{camera}" if isinstance(camera, int) else camera)
    if name not in cameras:
        raise CameraError(f"{source}: camera_name = {name}: there are {', '.join(cameras) or 'none'}; name one of these")
    return _camera(cameras[name], f"{source}: {name}")


def read_pair(text: str, source: str, roll_deg: float = 0.0) -> dict[str, Any] | None:
    """A camera mapping of kind ``fisheye_pair`` from a file of two cameras, ``cam0`` in front, whose images are joined left to right.

    Parameters
    ----------
    text : str
    source : str
        What to call the file.
    roll_deg : float
        How the front camera is turned about its axis: 180 if its sensor is upside down.

    Returns
    -------
    dict or None
        None if the file is none of this tool's, or of another number of cameras.

    Raises
    ------
    CameraError
        One of them is no fisheye, or nothing says how they are turned to each other.
    """
    cameras = _cameras(text, source)
    if cameras is None or set(cameras) != {"cam0", "cam1"}:
        return None
    front, back = (_camera(cameras[name], f"{source}: {name}") for name in ("cam0", "cam1"))
    if front.size_px is None:
        raise CameraError(f"{source}: cam0: key 'resolution' is missing; add it")
    if "T_cn_cnm1" in cameras["cam1"]:
        turned = _turned(cameras["cam1"], "T_cn_cnm1", f"{source}: cam1").T
    else:
        of_front, of_back = (_turned(cameras[name], "T_cam_imu", f"{source}: {name}") for name in ("cam0", "cam1"))
        turned = of_front @ of_back.T
    # From the axes of the back camera, as a body, to those of the front camera, and to the robot's.
    yaw, pitch, roll = angles_deg(rotation(0.0, 0.0, roll_deg) @ OPTICAL @ turned @ OPTICAL.T)
    return {
        "kind": "fisheye_pair",
        "front": {**front.of_one_lens(), "roll_deg": roll_deg},
        "back": {
            **back.of_one_lens(),
            **{"yaw_deg": yaw, "pitch_deg": pitch, "roll_deg": roll, "offset_px": [front.size_px[0], 0]},
        },
    }


def _turned(data: Mapping[str, Any], key: str, source: str) -> NDArray[np.float64]:
    """The rotation of a transform."""
    rows = data.get(key)
    values = numbers_of({key: None if rows is None else np.ravel(rows).tolist()}, key, 16, source)
    return np.array(values).reshape(4, 4)[:3, :3]


def _cameras(text: str, source: str) -> dict[str, Mapping[str, Any]] | None:
    """Of each camera in a file of this tool what it says; None if it is none. OpenVINS puts OpenCV's first line above the same."""
    names = re.search(r"^cam\d+:", text, re.MULTILINE) is not None
    if "camera_model:" not in text or "intrinsics:" not in text or (text.startswith("%YAML:1.0") and not names):
        return None
    try:
        chain = parse_yaml(re.sub(r"\A%YAML:1\.0.*", "", text), source)
    except ConfigError as error:
        raise CameraError(error.faults) from error
    if "camera_model" in chain:
        return {"cam0": chain}
    return {key: value for key, value in chain.items() if isinstance(value, Mapping) and "camera_model" in value}


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

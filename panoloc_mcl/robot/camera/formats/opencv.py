"""YAML that programs with OpenCV write for ``omnidir`` (camera matrix, ``xi``, four coefficients) or ``fisheye`` (no ``xi``).

OpenCV fixes no names: those of its own samples and of common programs are known.
"""

from __future__ import annotations

from typing import Any

from panoloc_mcl.robot.camera.formats.calibration import Calibration, numbers_of, size_of
from panoloc_mcl.robot.camera.formats.opencv_yaml import parse_opencv
from panoloc_mcl.robot.errors import CameraError

_MATRIX = ("camera_matrix", "K", "cameraMatrix", "Camera_Matrix", "intrinsics", "M1")
_DISTORTION = ("distortion_coefficients", "D", "distCoeffs", "Distortion_Coefficients", "dist_coeffs", "D1")
_WIDTH, _HEIGHT = ("image_width", "width", "image_Width"), ("image_height", "height", "image_Height")


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    if not text.startswith("%YAML") and "opencv-matrix" not in text:
        return None
    data = parse_opencv(text, source)
    matrix, distortion = _first(data, _MATRIX), _first(data, _DISTORTION)
    if matrix is None:
        return None
    if distortion is None:
        raise CameraError(f"{source}: no distortion coefficients ({', '.join(_DISTORTION)}); add them")
    fx, skew, cx, _, fy, cy, *_ = numbers_of(data, matrix, 9, source)
    coefficients = numbers_of(data, distortion, (4, 5, 8, 12, 14), source)
    if len(coefficients) != 4:
        raise CameraError(
            f"{source}: {distortion}: {len(coefficients)} coefficients are those of a pinhole camera; calibrate with cv::fisheye or "
            "cv::omnidir (4 coefficients)"
        )
    lens: dict[str, Any] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    if "xi" in data:
        xi = data["xi"] if isinstance(data["xi"], list) else [data["xi"]]
        lens |= {"kind": "mei", "xi": numbers_of({"xi": xi}, "xi", 1, source)[0], "skew": skew}
        lens |= {"k": coefficients[:2], "p": coefficients[2:]}
    else:
        lens |= {"kind": "kannala_brandt", "k": coefficients}
    return Calibration("OpenCV", lens, _size(data, source))


def _first(data: dict[str, Any], names: tuple[str, ...]) -> str | None:
    return next((name for name in names if data.get(name) is not None), None)


def _size(data: dict[str, Any], source: str) -> tuple[int, int] | None:
    width, height = _first(data, _WIDTH), _first(data, _HEIGHT)
    if width is not None and height is not None:
        return size_of(data[width], data[height], source)
    both = data.get("image_size") or data.get("imageSize") or data.get("image_Size")
    return size_of(both[0], both[1], source) if isinstance(both, list) and len(both) == 2 else None

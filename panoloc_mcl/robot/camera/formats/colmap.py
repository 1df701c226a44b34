"""COLMAP's ``cameras.txt``: ``OPENCV_FISHEYE``, ``SIMPLE_RADIAL_FISHEYE``, ``RADIAL_FISHEYE`` and ``EQUIRECTANGULAR``.

COLMAP counts from the upper left corner of the image, where the first pixel's centre lies at (0.5, 0.5): half a pixel is taken off.
"""

from __future__ import annotations

from panoloc_mcl.robot.camera.formats.calibration import Calibration, numbers_of, size_of
from panoloc_mcl.robot.errors import CameraError

_FISHEYES = {"OPENCV_FISHEYE": 8, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL_FISHEYE": 5}
_OTHERS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "FOV", "THIN_PRISM_FISHEYE")


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    known = (*_FISHEYES, *_OTHERS, "EQUIRECTANGULAR")
    if not rows or any(len(row) < 4 or not row[0].isdigit() or row[1] not in known for row in rows):
        return None
    chosen = {row[0]: row for row in rows}
    number = rows[0][0] if camera is None else str(camera)
    if number not in chosen:
        raise CameraError(f"{source}: camera_name = {number}: there are {', '.join(chosen)}; name one of these")
    _, model, width, height, *parameters = chosen[number]
    where, size = f"{source}: camera {number}", size_of(width, height, source)
    if model == "EQUIRECTANGULAR":
        return Calibration("COLMAP", None, size)
    if model not in _FISHEYES:
        raise CameraError(f"{where}: model = {model}: is no panorama's; use {', '.join(_FISHEYES)} or EQUIRECTANGULAR")
    values = numbers_of({model: parameters}, model, _FISHEYES[model], where)
    if model == "OPENCV_FISHEYE":
        fx, fy, cx, cy, *k = values
    else:
        fx, cx, cy, *k = values
        fy = fx
    k += [0.0] * (4 - len(k))
    return Calibration("COLMAP", {"kind": "kannala_brandt", "fx": fx, "fy": fy, "cx": cx - 0.5, "cy": cy - 0.5, "k": k}, size)

"""``calib_results.txt`` of Scaramuzza's OCamCalib toolbox.

Numbers only, between lines of comment: the polynomial from the image to the ray, its inverse, the centre (row, column, counted from
0), the affine parameters c, d, e, and the image's height and width.
"""

from __future__ import annotations

from panoloc_mcl.robot.camera.formats.calibration import Calibration, numbers_of, size_of
from panoloc_mcl.robot.errors import CameraError

_PARTS = ("polynomial", "inverse polynomial", "center", "affine parameters", "image size")


def read(text: str, source: str, camera: str | int | None = None) -> Calibration | None:
    """Read the file's text; None if it is none of this tool's."""
    lines = [line.strip() for line in text.splitlines()]
    if not any(line.startswith("#") and "polynomial coefficients" in line.lower() for line in lines):
        return None
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    if len(rows) < len(_PARTS):
        raise CameraError(f"{source}: holds {len(rows)} rows of numbers where {len(_PARTS)} are needed; export it again")
    _counted(rows[0], _PARTS[0], source)
    inverse = _counted(rows[1], _PARTS[1], source)
    row, column = numbers_of({_PARTS[2]: rows[2]}, _PARTS[2], 2, source)
    c, d, e = numbers_of({_PARTS[3]: rows[3]}, _PARTS[3], 3, source)
    height, width = numbers_of({_PARTS[4]: rows[4]}, _PARTS[4], 2, source)
    # The tool's x runs down the rows, its y along the columns.
    lens = {"kind": "ocam", "inverse": inverse, "cx": column, "cy": row, "affine": [1.0, e, d, c]}
    return Calibration("OCamCalib", lens, size_of(width, height, source))


def _counted(row: list[str], name: str, source: str) -> list[float]:
    """A row that begins with how many numbers follow."""
    count = int(row[0]) if row[0].isdigit() else -1
    return numbers_of({name: row[1:]}, name, count if count > 1 else len(row), source)

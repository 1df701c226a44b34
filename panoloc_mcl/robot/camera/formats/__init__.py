"""Calibration files of other tools; which tool's it is, is told by what the file holds."""

from __future__ import annotations

from pathlib import Path

from panoloc_mcl.robot.camera.formats import camodocal, colmap, kalibr, ocamcalib, opencv, ros
from panoloc_mcl.robot.camera.formats.calibration import Calibration, number_of, numbers_of
from panoloc_mcl.robot.errors import CameraError

__all__ = ["READERS", "Calibration", "number_of", "numbers_of", "read_calibration"]

#: By name; each gives a `Calibration`, or None where the text is not one of its files.
READERS = {
    "OCamCalib": ocamcalib.read,
    "CamOdoCal": camodocal.read,
    "Kalibr": kalibr.read,
    "ROS camera_info": ros.read,
    "OpenCV": opencv.read,
    "COLMAP": colmap.read,
}


def read_calibration(path: Path, camera: str | int | None = None) -> Calibration:
    """Read the calibration file of another tool.

    Parameters
    ----------
    path : Path
        OCamCalib ``calib_results.txt``, Kalibr ``camchain.yaml``, OpenCV ``omnidir`` or ``fisheye`` YAML, CamOdoCal or MEI YAML, ROS
        ``camera_info`` YAML, or COLMAP ``cameras.txt``.
    camera : str or int, optional
        Which of several cameras in the file: Kalibr's ``cam1``, COLMAP's number; the first one if left out.

    Raises
    ------
    CameraError
        Missing, of unknown kind, of a model that is no panorama's, or with values that cannot be; one line each.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        reason = (
            "no such file; check the path" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
        )
        raise CameraError(f"{path}: {reason}") from error
    for reader in READERS.values():
        found = reader(text, str(path), camera)
        if found is not None:
            return found
    raise CameraError(f"{path}: is no calibration file of a known kind; use one of {', '.join(READERS)}")

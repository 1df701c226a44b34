"""The layout of the COLD database (Pronobis & Caputo, 2009): a sequence folder with images named by time and pose.

``omni_cam/t<s>.<us>_x<m>_y<m>_a<rad>.jpeg`` (or another folder), ``localization/places.lst``, ``odom_scans/odom.tdf``.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets.recordings.recording import Recording
from panoloc_mcl.tools.datasets.trajectory import Trajectory

_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_IMAGE = re.compile(rf"t(\d+)\.(\d+)_x({_NUMBER})_y({_NUMBER})_a({_NUMBER})\.(?:jpe?g|png)", re.IGNORECASE)
_FOLDERS = ("omni_cam", "images", "std_cam")


def is_cold(path: Path) -> bool:
    """Whether a folder has this layout."""
    return (
        path.is_dir()
        and ((path / "odom_scans").is_dir() or (path / "localization" / "places.lst").is_file())
        and _images(path)[0] != []
    )


def _images(path: Path) -> tuple[list[Path], list[str]]:
    """Files of the first folder that has some; and in which others there are some, too."""
    names = [path / name for name in _FOLDERS] + [path]
    names += [folder for folder in sorted(path.iterdir()) if folder.is_dir() and folder not in names]
    found = [
        (folder, sorted(file for file in folder.iterdir() if _IMAGE.fullmatch(file.name)))
        for folder in names
        if folder.is_dir()
    ]
    filled = [(folder, files) for folder, files in found if files]
    return (filled[0][1], [folder.name for folder, _ in filled[1:]]) if filled else ([], [])


def read_cold(path: Path) -> Recording:
    """Read a sequence; its images' names give times and true poses.

    Raises
    ------
    DatasetError
        ``odom.tdf`` has lines that cannot be read.
    """
    files, others = _images(path)
    matches = [match for match in (_IMAGE.fullmatch(file.name) for file in files) if match is not None]
    stamps = np.array([int(match[1]) * 10**9 + int(match[2]) * 1000 for match in matches], dtype=np.int64)
    poses = np.array([[float(match[part]) for part in (3, 4, 5)] for match in matches])
    order, first = np.unique(stamps, return_index=True)
    truth = Trajectory(np.array([int(stamp) / 10**9 for stamp in order]), poses[first])
    notes = [f"{path.name}: images of {files[0].parent.name} are used, not those of {', '.join(others)}"] if others else []
    return Recording(path.name, path, stamps, tuple(files), _odometry(path / "odom_scans" / "odom.tdf"), truth, notes)


def _odometry(path: Path) -> Trajectory | None:
    """Fields, counted from 1: stamps in 3 (s) and 4 (µs), x, y and heading in 8, 9 and 11."""
    if not path.is_file():
        return None
    rows: dict[int, tuple[float, float, float]] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        fields = line.split()
        if len(fields) < 12:
            continue
        try:
            stamp = int(fields[2]) * 10**9 + int(fields[3]) * 1000
            x, y, heading = float(fields[7]), float(fields[8]), float(fields[10])
        except ValueError as error:
            raise DatasetError(f"{path}:{number}: {error}; mend or drop this line") from error
        if np.isfinite([x, y, heading]).all():
            rows.setdefault(stamp, (x, y, heading))
    if not rows:
        return None
    stamps = sorted(rows)
    return Trajectory(np.array([stamp / 10**9 for stamp in stamps]), np.array([rows[stamp] for stamp in stamps]))

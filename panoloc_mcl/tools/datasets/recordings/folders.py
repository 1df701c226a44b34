"""A folder of images with trajectories beside them, and the tables that may stand beside a video."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.files import text_of
from panoloc_mcl.tools.datasets.recordings.recording import Recording
from panoloc_mcl.tools.datasets.trajectory import Trajectory, read_tum

IMAGES = (".png", ".jpg", ".jpeg")
_STAMP = re.compile(r"(?:.*?[^0-9.])?(\d+)(?:\.(\d{1,9}))?")
_SURELY_A_STAMP = re.compile(r"\d+\.\d{1,9}|\d{10,}")  # a counter such as f003 or 0003 is not
_HEADINGS = ("theta", "yaw", "heading")
_TIMES = ("timestamp", "time", "stamp", "t")


def is_folder_of_images(path: Path) -> bool:
    """Whether a folder holds images whose names are times, and a trajectory."""
    if not path.is_dir() or (path / "dataset.yaml").exists() or (path / "frames.csv").exists():
        return False
    return any(track_beside(path, "", part) for part in ("odometry", "groundtruth")) and len(_images(path)) > 0


def is_named_by_times(path: Path) -> bool:
    """Whether all images of a folder are named by times and not by counters: a drive that lost its frames.csv is no recording."""
    return all(_SURELY_A_STAMP.fullmatch(file.stem) for file in _images(path))


def _images(path: Path) -> list[Path]:
    inside = [path, *(path / name for name in ("images", "rgb", "image") if (path / name).is_dir())]
    return next(
        (found for folder in inside if (found := sorted(f for f in folder.iterdir() if f.suffix.lower() in IMAGES))), []
    )


def read_folder(path: Path) -> Recording:
    """Images named by their time in seconds (``1305031102.175304.png``) or nanoseconds, with TUM or CSV files beside them.

    Raises
    ------
    DatasetError
        Names that are no times, or tables that cannot be read.
    """
    files = _images(path)
    matches = [_STAMP.fullmatch(file.stem) for file in files]
    bad = next((file for file, match in zip(files, matches, strict=True) if match is None), None)
    if bad is not None:
        raise DatasetError(f"{bad}: its name is no time; name images by seconds, such as 1305031102.175304.png")
    stamps = np.array([_nanoseconds(match[1], match[2]) for match in matches if match is not None], dtype=np.int64)
    return Recording(
        path.name, path, stamps, tuple(files), track_beside(path, "", "odometry"), track_beside(path, "", "groundtruth")
    )


def _nanoseconds(whole: str, rest: str | None) -> int:
    if rest is None and len(whole) >= 16:
        return int(whole)
    return int(whole) * 10**9 + (0 if rest is None else int(rest.ljust(9, "0")))


def track_beside(folder: Path, stem: str, part: str) -> Trajectory | None:
    """The trajectory ``[STEM.]PART.tum`` or ``.csv``; odometry may also be ``STEM.tum`` or ``STEM.csv``; None if there is none."""
    names = [f"{stem}.{part}" if stem else part]
    if stem and part == "odometry":
        names.append(stem)
    for name in names:
        if (folder / f"{name}.tum").is_file():
            return read_tum(folder / f"{name}.tum")
        if (folder / f"{name}.csv").is_file():
            return _read_csv(folder / f"{name}.csv")
    return None


def _read_csv(path: Path) -> Trajectory:
    """Columns of a time, x, y and a heading in radians, in any order and among others."""
    with io.StringIO(text_of(path, DatasetError), newline="") as stream:
        rows = csv.DictReader(stream, skipinitialspace=True)
        known = {name.strip().lower(): name for name in rows.fieldnames or ()}
        columns = [
            next((known[name] for name in names if name in known), None) for names in (_TIMES, ("x",), ("y",), _HEADINGS)
        ]
        if None in columns:
            raise DatasetError(f"{path}:1: columns are {', '.join(known) or 'none'}; needs timestamp, x, y, theta")
        table = []
        for number, row in enumerate(rows, start=2):
            try:
                table.append([float(row[column] or "") for column in columns if column is not None])
            except (TypeError, ValueError) as error:
                raise DatasetError(f"{path}:{number}: {error}; mend or drop this row") from error
    if not table:
        raise DatasetError(f"{path}: holds no poses; needs rows of timestamp, x, y, theta")
    values = np.array(table)
    return Trajectory(values[:, 0], values[:, 1:])


def stamps_beside(path: Path, stem: str) -> list[int] | None:
    """Stamps of a video's frames, nanoseconds, from ``STEM.frames.csv`` with a column ``timestamp``; None if there is none."""
    file = path / f"{stem}.frames.csv"
    if not file.is_file():
        return None
    lines = [line.split(",")[0].strip() for line in text_of(file, DatasetError).splitlines() if line.strip()]
    stamps = []
    for number, line in enumerate(lines[1:], start=2):
        match = re.fullmatch(r"(\d+)(?:\.(\d{1,9}))?", line)
        if match is None:
            raise DatasetError(f"{file}:{number}: '{line}' is no time in seconds; mend or drop this row")
        stamps.append(_nanoseconds(match[1], match[2] or "0"))
    return stamps

"""The layout of the Hilti-Trimble-Oxford data set (Centanni, Zhang et al., 2026): handheld dual fisheyes on building sites.

``data/floor_X/DATE/run_N/rosbag/{metadata.yaml, rosbag.db3}`` with ``/cam0/image_raw/compressed`` (front) and ``/cam1/…`` (back), both
upside down; Kalibr files in ``camera_calibration/`` and poses of cam0, of the axes of its image, in
``groundtruth/**/floor_X_DATE_run_N.txt``. There is no odometry; an ``odometry.tum`` in the run's folder is taken. The IMU is not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from panoloc_mcl.robot.camera.formats import kalibr
from panoloc_mcl.robot.camera.spec import AnyCamera, camera_from_mapping
from panoloc_mcl.robot.errors import CameraError, DatasetError
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets.recordings.folders import track_beside
from panoloc_mcl.tools.datasets.recordings.recording import Recording
from panoloc_mcl.tools.datasets.trajectory import Trajectory

_TOPICS = ("/cam0/image_raw/compressed", "/cam1/image_raw/compressed")
# So far above a run its calibration and ground truth are looked for.
_LEVELS = 6
# Sensors are built in upside down.
_ROLL_DEG = 180.0


def is_hilti(path: Path) -> bool:
    """Whether a folder is a run of this layout: it holds the folder of a bag, ``rosbag``."""
    return (path / "rosbag" / "metadata.yaml").is_file()


def read_hilti(path: Path, settings: RecordingSettings) -> Recording:
    """Read a run.

    Raises
    ------
    DatasetError
        Its bag or its ground truth cannot be read.
    CameraError
        Its calibration cannot be read.
    """
    from panoloc_mcl.tools.datasets.recordings.ros.reading import read_bag

    if settings.image_topic is None:
        settings = settings.model_copy(update={"image_topic": _TOPICS})
    found = read_bag(path / "rosbag", settings)
    name = _name(path)
    found.name, found.path = name, path
    found.odometry = track_beside(path, "", "odometry") or found.odometry
    truth = next(_above(path, f"groundtruth/**/{name}.txt"), None)
    if truth is not None:
        found.truth = _truth(truth)
    found.camera = _camera(path)
    return found


def _name(path: Path) -> str:
    """``floor_1_2025-05-05_run_1`` from the folders above, as ground truth is called."""
    parts = path.absolute().parts[-3:]
    return "_".join(parts) if len(parts) == 3 and parts[0].startswith("floor") else path.name


def _above(path: Path, pattern: str) -> Iterator[Path]:
    for folder in path.absolute().parents[:_LEVELS]:
        yield from sorted(folder.glob(pattern))


def _camera(path: Path) -> AnyCamera | None:
    """Of the Kalibr file of both cameras that is nearest above; one of the enhanced unified model before others."""
    chains = []
    for file in [*_above(path, "camera_calibration/**/*.yaml"), *sorted(path.glob("*.yaml"))]:
        text = file.read_text(encoding="utf-8", errors="replace")
        pair = kalibr.read_pair(text, str(file), _ROLL_DEG)
        if pair is not None:
            chains.append((pair["front"]["lens"]["kind"] != "eucm", file, pair))
    if not chains:
        return None
    _, file, pair = min(chains, key=lambda chain: chain[0])
    try:
        return camera_from_mapping(pair, str(file))
    except CameraError as error:
        raise CameraError(error.faults) from error


def _truth(path: Path) -> Trajectory:
    """Poses of a camera in TUM's format, of the axes of its image (x right, y down, z ahead): the heading is where it looks."""
    from scipy.spatial.transform import Rotation

    try:
        table = np.loadtxt(path, ndmin=2)
        if table.shape[1] != 8:
            raise ValueError(f"{table.shape[1]} columns instead of 8")
        ahead = Rotation.from_quat(table[:, 4:]).apply([0.0, 0.0, 1.0])
    except (OSError, ValueError) as error:
        raise DatasetError(
            f"{path}: is no trajectory in TUM's format ({' '.join(str(error).split())}); check the file"
        ) from error
    times, first = np.unique(table[:, 0], return_index=True)
    headings = np.array([math.atan2(y, x) for x, y, _ in ahead[first]])
    return Trajectory(times, np.column_stack([table[first, 1:3], headings]))

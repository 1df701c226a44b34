"""Recordings in the layouts that people have: bags of ROS, MCAP files, COLD, videos, folders of images. One file a layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoloc_mcl.robot.camera.files import read_camera
from panoloc_mcl.robot.camera.spec import AnyCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets.dataset import Dataset, Sequence
from panoloc_mcl.tools.datasets.recordings.cold import is_cold, read_cold
from panoloc_mcl.tools.datasets.recordings.folders import is_folder_of_images, is_named_by_times, read_folder
from panoloc_mcl.tools.datasets.recordings.recording import Recording
from panoloc_mcl.tools.datasets.recordings.ros.hilti import is_hilti, read_hilti
from panoloc_mcl.tools.datasets.recordings.video import VIDEOS, read_video

__all__ = [
    "FILES",
    "Recording",
    "dataset_of_recordings",
    "is_folder_of_images",
    "is_named_by_times",
    "is_recording",
    "read_recording",
    "recordings_in",
    "sequence_of",
]

#: Endings of recordings that are single files.
FILES = (".bag", ".mcap", ".db3", *VIDEOS)


def is_recording(path: Path) -> bool:
    """Whether a path is a recording in one of these layouts, by its look; not by opening it."""
    if path.is_file():
        return path.suffix.lower() in FILES
    return (path / "metadata.yaml").is_file() or is_hilti(path) or is_folder_of_images(path) or is_cold(path)


def read_recording(path: Path, settings: RecordingSettings | None = None) -> Recording:
    """Read all of a recording but its images.

    Raises
    ------
    DatasetError
        It cannot be read; what is missing, or what must be named.
    """
    settings = settings or RecordingSettings()
    if path.suffix.lower() in VIDEOS:
        return read_video(path)
    if is_hilti(path):
        return read_hilti(path, settings)
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        return read_folder(path) if is_folder_of_images(path) else read_cold(path)
    # Here, so that the other layouts do without the extra.
    from panoloc_mcl.tools.datasets.recordings.ros.reading import read_bag

    return read_bag(path, settings)


def recordings_in(path: Path) -> list[Path]:
    """The recordings in a folder that is neither a data set nor a recording itself."""
    if not path.is_dir() or (path / "dataset.yaml").exists() or is_recording(path):
        return []
    return sorted(entry for entry in path.iterdir() if not entry.name.startswith(".") and is_recording(entry))


def sequence_of(
    path: Path,
    settings: RecordingSettings | None = None,
    camera: AnyCamera | None = None,
    otherwise: AnyCamera | None = None,
) -> Sequence:
    """A recording as a drive.

    Parameters
    ----------
    path : Path
    settings : RecordingSettings, optional
    camera : AnyCamera, optional
        If neither the settings nor a file beside the recording say which.
    otherwise : AnyCamera, optional
        If the recording itself does not say it either.

    Raises
    ------
    DatasetError, CameraError
        The recording or the camera's file cannot be read, or there is no camera.
    """
    settings = settings or RecordingSettings()
    inside = path if path.is_dir() else path.parent
    names = path.parent / f"{path.stem}.camera.yaml", inside / "camera.yaml", path.parent / "camera.yaml"
    beside = [settings.camera, *names]
    file = next((file for file in beside if file is not None and (file == settings.camera or file.is_file())), None)
    if file is not None:
        camera = read_camera(file)
    recording = read_recording(path, settings)
    if camera is None and recording.camera is not None:
        camera = recording.camera
        recording.notes.extend(filter(None, [recording.camera_note and f"{path.name}: {recording.camera_note}"]))
    camera = camera or otherwise
    if camera is None:
        raise DatasetError(
            f"{path}: nothing says which camera this is; set recording.camera to its camera.yaml, put one beside it, or set map"
            + (f" ({recording.camera_note})" if recording.camera_note else "")
        )
    return recording.sequence(camera)


def dataset_of_recordings(path: Path, settings: RecordingSettings | None, camera: AnyCamera | None) -> Dataset:
    """A recording, or all recordings of a folder, as a data set without references.

    Parameters
    ----------
    path : Path
    settings : RecordingSettings or None
    camera : AnyCamera or None
        Of recordings that nothing else is known of.

    Raises
    ------
    DatasetError, CameraError
        As `sequence_of`; every fault of all recordings.
    """
    sequences: dict[str, Sequence] = {}
    faults: list[str] = []
    for entry in recordings_in(path) or [path]:
        try:
            sequence = sequence_of(entry, settings, otherwise=camera)
            sequences[sequence.name] = sequence
        except DatasetError as error:
            faults.extend(error.faults)
    if faults:
        raise DatasetError(faults)
    first = next(iter(sequences.values()))
    none = References(path, (), np.empty((0, 3)), first.camera, first.image_size)
    name = path.stem if path.is_file() else path.name
    return Dataset(name, path, f"recorded in {path.name}", "", first.camera, none, sequences)

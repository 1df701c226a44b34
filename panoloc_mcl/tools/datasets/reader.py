"""Reads a data set folder (layout ``panoloc-dataset/1``) and reports every fault in it at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from panoloc_mcl.robot.camera.files import camera_with_files, read_camera
from panoloc_mcl.robot.camera.spec import AnyCamera, Camera
from panoloc_mcl.robot.camera.unwrap import Unwrapper, geometry_of
from panoloc_mcl.robot.errors import CameraError, ConfigError, DatasetError, ImageError
from panoloc_mcl.robot.files import known_errors
from panoloc_mcl.robot.images import ImageSource, image_size
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.validation import StrictModel, read_yaml, validate
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets.dataset import Dataset, Sequence
from panoloc_mcl.tools.datasets.embedded import EMBEDDED
from panoloc_mcl.tools.datasets.pairs import paired
from panoloc_mcl.tools.datasets.recordings import (
    dataset_of_recordings,
    is_folder_of_images,
    is_named_by_times,
    is_recording,
    recordings_in,
    sequence_of,
)
from panoloc_mcl.tools.datasets.tables import ImageTable, read_image_table
from panoloc_mcl.tools.datasets.trajectory import Trajectory, read_tum

FORMAT = "panoloc-dataset/1"
_MOST_FAULTS = 10


class ReferencePoses(StrictModel):
    """Whose poses stand in ``poses.csv``: those of the robot's base, as all others, or of the camera on it."""

    poses_of: Literal["base", "camera"] = "base"


class DatasetFile(StrictModel):
    """The contents of ``dataset.yaml``."""

    format: Literal["panoloc-dataset/1"]
    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    licence: str = ""
    camera: Camera
    references: ReferencePoses = ReferencePoses()


@dataclass
class Scan:
    """What could be read of a data set, and what could not.

    Parameters
    ----------
    dataset : Dataset or None
        None when ``dataset.yaml`` or the references are unusable; faulty sequences are left out of it.
    faults : list of str
        One line each; empty for a good data set.
    references : References or None
    sequences : list of Sequence
        Those without faults.
    """

    dataset: Dataset | None = None
    faults: list[str] = field(default_factory=list)
    references: References | None = None
    sequences: list[Sequence] = field(default_factory=list)


def read_dataset(path: str | Path, recording: RecordingSettings | None = None, camera: AnyCamera | None = None) -> Dataset:
    """Read a data set, or a recording, or a folder of recordings; images are looked up and measured, not decoded.

    Parameters
    ----------
    path : str or Path
        Of a folder or a file; or the name of a data set that comes with the package.
    recording : RecordingSettings, optional
        What recordings do not say themselves.
    camera : AnyCamera, optional
        Of recordings that nothing else is known of.

    Raises
    ------
    DatasetError
        Every fault found, one line each.
    """
    path = Path(path) if Path(path).exists() else EMBEDDED.get(str(path), Path(path))
    if is_recording(path) or recordings_in(path):
        return dataset_of_recordings(path, recording, camera)
    scan = scan_dataset(path, recording)
    if scan.faults or scan.dataset is None:
        raise DatasetError(scan.faults)
    return scan.dataset


def scan_dataset(path: Path, recording: RecordingSettings | None = None) -> Scan:
    """Read as much of a data set as possible and collect the faults instead of raising them."""
    scan = Scan()
    try:
        with known_errors(DatasetError, path):
            _scan(path, recording, scan)
    except DatasetError as error:
        scan.faults.extend(error.faults)
    return scan


def _scan(path: Path, recording: RecordingSettings | None, scan: Scan) -> Scan:
    if not path.is_dir():
        scan.faults.append(f"{path}: no such folder; name a data set folder (one that holds dataset.yaml)")
        return scan
    if not any((path / part).exists() for part in ("dataset.yaml", "references", "sequences")):
        scan.faults.append(
            f"{path}: neither a data set (it holds no dataset.yaml) nor a recording (a bag, mcap, video or COLD sequence, or images "
            "named by their times beside an odometry.tum); check the path"
        )
        return scan
    info = _read_info(path / "dataset.yaml", scan.faults)
    camera = info.camera if info is not None else None
    # Folders that share the camera of dataset.yaml must share its image size, too.
    shared: dict[str, tuple[Path, tuple[int, int]]] = {}
    if (path / "references").exists() or not _sequence_entries(path / "sequences"):
        scan.references = _read_references(path / "references", camera, info, shared, scan.faults)
    for entry in _sequence_entries(path / "sequences"):
        if _is_recorded(entry):
            sequence = _read_recorded(entry, recording, camera, scan.faults)
        else:
            sequence = _read_sequence(entry, camera, shared, scan.faults)
        if sequence is not None:
            scan.sequences.append(sequence)
    if info is not None and not (path / "references").exists() and scan.sequences:
        # Drives alone: the map comes from elsewhere, or from one of them.
        size = scan.sequences[0].image_size
        scan.references = References(path / "references", (), np.empty((0, 3)), info.camera, size)
    if info is not None and scan.references is not None:
        by_name = {sequence.name: sequence for sequence in scan.sequences}
        _, camera = paired((), path, info.camera, [])
        scan.dataset = Dataset(info.name, path, info.description, info.licence, camera or info.camera, scan.references, by_name)
    return scan


def _read_info(path: Path, faults: list[str]) -> DatasetFile | None:
    try:
        data = read_yaml(path)
        if isinstance(data.get("camera"), Mapping):
            data["camera"] = camera_with_files(data["camera"], path.parent, str(path), "camera.")
        return validate(DatasetFile, data, str(path))
    except (CameraError, ConfigError) as error:
        faults.extend(error.faults)
        return None


def _sequence_entries(path: Path) -> list[Path]:
    """Folders with images and recordings."""
    if not path.is_dir():
        return []
    seen = sorted(entry for entry in path.iterdir() if not entry.name.startswith("."))
    return [entry for entry in seen if entry.is_dir() or is_recording(entry)]


def _is_recorded(entry: Path) -> bool:
    # A folder of images with other names than times is one of ours that lacks its table.
    return is_recording(entry) and (not is_folder_of_images(entry) or is_named_by_times(entry))


def _read_recorded(
    path: Path, settings: RecordingSettings | None, camera: AnyCamera | None, faults: list[str]
) -> Sequence | None:
    try:
        return sequence_of(path, settings, camera)
    except (DatasetError, CameraError, ConfigError) as error:
        faults.extend(error.faults)
        return None


def _read_references(
    folder: Path,
    camera: AnyCamera | None,
    info: DatasetFile | None,
    shared: dict[str, tuple[Path, tuple[int, int]]],
    faults: list[str],
) -> References | None:
    if not folder.is_dir():
        faults.append(f"{folder}: no such folder; add the reference images and their poses.csv")
        return None
    table = read_image_table(
        folder / "poses.csv", ("x", "y"), None, faults, folder.parent, ("sd_xy", "sd_theta"), unknown=("theta",)
    )
    files, seen_by, size = _images_of(folder, table, camera, faults)
    if table is None or seen_by is None or size is None or not _fits(folder, seen_by, size, shared, faults):
        return None
    poses_of = info.references.poses_of if info is not None else "base"
    poses, sds = table.numbers[:, :3].copy(), table.numbers[:, 3:].copy()
    # A heading that is not given may be any: the map finds it.
    unknown = np.isnan(poses[:, 2])
    poses[unknown, 2], sds[unknown, 1] = 0.0, np.inf
    known = None if np.isnan(sds).all() else sds
    return References(folder, files, poses, seen_by, size, poses_of, known)


def _read_sequence(
    folder: Path,
    camera: AnyCamera | None,
    shared: dict[str, tuple[Path, tuple[int, int]]],
    faults: list[str],
) -> Sequence | None:
    before = len(faults)
    table = read_image_table(folder / "frames.csv", ("timestamp",), "timestamp", faults, folder.parents[1])
    odometry = _read_trajectory(folder / "odometry.tum", faults)
    groundtruth = _read_trajectory(folder / "groundtruth.tum", faults)
    files, seen_by, size = _images_of(folder, table, camera, faults, spared=True)
    if table is None or seen_by is None or size is None or not _fits(folder, seen_by, size, shared, faults):
        return None
    if len(faults) > before:
        return None
    # By the clock of odometry from here on, so the camera that goes with it has no offset any more.
    times = table.numbers[:, 0] + seen_by.stamp_offset_s
    if seen_by.time_offset_s is not None:
        seen_by = seen_by.model_copy(update={"time_offset_s": None})
    return Sequence(folder.name, folder, times, files, seen_by, size, odometry, groundtruth)


def _read_trajectory(path: Path, faults: list[str]) -> Trajectory | None:
    if not path.exists():
        return None
    try:
        return read_tum(path)
    except DatasetError as error:
        faults.extend(error.faults)
        return None


def _folder_camera(folder: Path, camera: AnyCamera | None, faults: list[str]) -> AnyCamera | None:
    path = folder / "camera.yaml"
    if not path.exists():
        return camera
    try:
        return read_camera(path)
    except (ConfigError, CameraError) as error:
        faults.extend(error.faults)
        return None


def _images_of(
    folder: Path, table: ImageTable | None, camera: AnyCamera | None, faults: list[str], spared: bool = False
) -> tuple[tuple[ImageSource, ...], AnyCamera | None, tuple[int, int] | None]:
    """Images of a folder, their camera, and their size; None for what is faulty."""
    seen_by = _folder_camera(folder, camera, faults)
    if table is None:
        return (), seen_by, None
    before = len(faults)
    files, seen_by = paired(table.files, folder, seen_by, faults)
    return files, seen_by, None if len(faults) > before else _common_size(folder, files, faults, spared)


def _common_size(folder: Path, files: tuple[ImageSource, ...], faults: list[str], spared: bool) -> tuple[int, int] | None:
    """Size of a folder's images; ``spared``: a damaged frame of a drive is met when its turn comes, and does not end the run."""
    sizes: dict[ImageSource, tuple[int, int]] = {}
    damaged: list[str] = []
    for file in files:
        try:
            sizes[file] = image_size(file)
        except ImageError as error:
            damaged.extend(error.faults)
    found = list(damaged) if not (spared and sizes) else []
    if sizes:
        common = Counter(sizes.values()).most_common(1)[0][0]
        for file, size in sizes.items():
            if size != common:
                found.append(
                    f"{file}: {size[0]} x {size[1]} pixels where the other images of {folder} have "
                    f"{common[0]} x {common[1]}; resize or drop it"
                )
    more = len(found) - _MOST_FAULTS
    faults.extend(found[:_MOST_FAULTS] + ([f"{folder}: and {more} more images like these"] if more > 0 else []))
    return common if sizes and not found else None


def _fits(
    folder: Path,
    camera: AnyCamera,
    size: tuple[int, int],
    shared: dict[str, tuple[Path, tuple[int, int]]],
    faults: list[str],
) -> bool:
    """Whether the camera can have taken images of this size."""
    if not (folder / "camera.yaml").exists():
        other, other_size = shared.setdefault("size", (folder, size))
        if other_size != size:
            faults.append(
                f"{folder}: images of {size[0]} x {size[1]} pixels where {other} has {other_size[0]} x {other_size[1]}, "
                "with the same camera of dataset.yaml; add a camera.yaml that describes its own camera to this folder"
            )
            return False
    try:
        Unwrapper(camera, size, geometry_of(camera, size))
    except CameraError as error:
        faults.extend(f"{folder}: {fault}" for fault in error.faults)
        return False
    return True

"""Small files of every kind that the package reads, and what reads them."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from panoloc_mcl.laboratory.comparison.matrix import load_matrix
from panoloc_mcl.laboratory.layouts import LAYOUTS
from panoloc_mcl.robot.camera.formats import read_calibration
from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.images import image_size, read_image, write_image
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.observation import ObservationSettings
from panoloc_mcl.tools.config import RunConfig, config_to_yaml, load_config
from panoloc_mcl.tools.config.live import load_live_config
from panoloc_mcl.tools.datasets import Dataset, DatasetWriter, Sequence, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets.check import check_dataset

_SIZE, _REFERENCES, _FRAMES = (72, 29), 5, 5
# One layout a format is enough.
_LAYOUTS = ("ros1", "ros1-lz4", "ros2-sqlite3", "ros2-mcap-png", "mcap-zstd", "cold", "folder", "mcap-jpeg")
_COMPARISON = """\
format: panoloc-comparison/1
name: a
datasets: [small]
modes: {monte_carlo: {}, odometry_only: {initial: known_pose}}
seeds: 2
"""


@dataclass(frozen=True)
class Input:
    """Files of one kind.

    Parameters
    ----------
    kind : str
    files : tuple of Path
        One of them is damaged at a time.
    read : callable (folder, file)
        Reads them as a command would, given the folder of everything; raises known errors.
    """

    kind: str
    files: tuple[Path, ...]
    read: Callable[[Path, Path], Any]


def originals(folder: Path, extra: Iterable[Path] = ()) -> list[Input]:
    """Write one small, good file of every kind under a folder.

    Parameters
    ----------
    folder : Path
    extra : iterable of Path
        Calibration files of other tools, to be damaged, too.

    Returns
    -------
    list of Input
        Paths are relative to the folder.
    """
    data = _small(folder / "data")
    write_atomically(folder / "run.yaml", config_to_yaml(RunConfig(dataset="data")))
    write_atomically(folder / "live.yaml", "input: {recording: data, rate: 1.0}\nmap: small.panomap\nseed: 3\n")
    write_atomically(folder / "compare.yaml", _COMPARISON)
    panorama_map = PanoramaMap.build(data)
    panorama_map.save(folder / "small.panomap")
    localizer = _driven(panorama_map, data)
    localizer.save_state(folder / "state.npz")

    def go_on(root: Path, file: Path) -> None:
        Localizer(panorama_map, localizer.config).resume(root / file)

    def use(root: Path, file: Path) -> None:
        PanoramaMap.load(root / file).observation_model(ObservationSettings())

    def faults_of(root: Path, file: Path) -> None:
        _raise(check_dataset(root / file.parts[0]))

    tables = ("*.yaml", "*.csv", "*.tum")
    inputs = [
        Input("configuration of a run", (Path("run.yaml"),), lambda root, file: load_config(root / file)),
        Input("configuration of a live robot", (Path("live.yaml"),), lambda root, file: load_live_config(root / file)),
        Input("comparison", (Path("compare.yaml"),), lambda root, file: load_matrix(root / file)),
        Input("tables of a data set", _under(folder, "data", *tables), faults_of),
        Input("images of a data set", _under(folder, "data", "*.png"), faults_of),
        Input("PNG", (_picture(folder / "a.png"),), lambda root, file: (image_size(root / file), read_image(root / file))),
        Input("JPEG", (_picture(folder / "a.jpg"),), lambda root, file: (image_size(root / file), read_image(root / file))),
        Input("map", (Path("small.panomap"),), use),
        Input("saved state", (Path("state.npz"),), go_on),
    ]
    for layout in _LAYOUTS:
        root = folder / layout
        shutil.copytree(data.path, root, ignore=shutil.ignore_patterns("sequences"))
        (root / "sequences").mkdir()
        for drive in data.sequences.values():
            LAYOUTS[layout].write(drive, root / "sequences" / drive.name)
        inputs.append(Input(f"recording, {layout}", _under(folder, f"{layout}/sequences", "*"), _look_at_all))
    for calibration in extra:
        shutil.copy(calibration, folder / calibration.name)
        inputs.append(
            Input(
                f"calibration, {calibration.name}",
                (Path(calibration.name),),
                lambda root, file: read_calibration(root / file).mapping(),
            )
        )
    return inputs


def _small(path: Path) -> Dataset:
    """A few places of the embedded hall, of few pixels."""
    hall = read_dataset(resolve_dataset("hall"))
    writer = DatasetWriter(path, "small", hall.references.camera, description="of the embedded hall", licence="CC0-1.0")
    near = np.argsort(np.hypot(*(hall.references.poses[:, :2] - hall.references.poses[0, :2]).T))[:_REFERENCES]
    writer.add_references((_shrunk(hall.references.files[index]) for index in near), hall.references.poses[near])
    drive = next(iter(hall.sequences.values())).of(np.arange(_FRAMES))
    writer.add_sequence(
        "drive",
        drive.times,
        (_shrunk(file) for file in drive.files),
        _until(drive.odometry, drive),
        _until(drive.groundtruth, drive),
    )
    return read_dataset(writer.finish())


def _until(track: Any, drive: Sequence) -> Any:
    """As much of a trajectory as the drive takes, and a little more."""
    kept = track.times <= drive.times[-1] + 0.5
    return type(track)(track.times[kept], track.poses[kept])


def _shrunk(file: Any) -> Any:
    return cv2.resize(read_image(file), _SIZE, interpolation=cv2.INTER_AREA)


def _driven(panorama_map: PanoramaMap, data: Dataset) -> Localizer:
    localizer = Localizer(panorama_map, LocalizerConfig(seed=1))
    for drive in data.sequences.values():
        assert drive.odometry is not None
        for time, pose in zip(drive.odometry.times, drive.odometry.poses, strict=True):
            localizer.add_odometry(float(time), pose)
        for time, file in zip(drive.times, drive.files, strict=True):
            localizer.add_image(float(time), read_image(file))
    return localizer


def _picture(path: Path) -> Path:
    rng = np.random.default_rng(0)
    write_image(path, np.clip(cv2.resize(rng.random((6, 12)) * 255.0, _SIZE), 0, 255).astype(np.uint8))
    return Path(path.name)


def _under(folder: Path, where: str, *patterns: str) -> tuple[Path, ...]:
    found = {path for pattern in patterns for path in (folder / where).rglob(pattern) if path.is_file()}
    return tuple(path.relative_to(folder) for path in sorted(found))


def _look_at_all(root: Path, file: Path) -> None:
    for drive in read_dataset(root / file.parts[0]).sequences.values():
        for image in drive.files:
            read_image(image)


def _raise(faults: list[str]) -> None:
    if faults:
        raise PanolocError(faults)

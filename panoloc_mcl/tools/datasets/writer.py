"""Writes data sets in the layout that the reader reads."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera.spec import AnyCamera, to_mapping
from panoloc_mcl.robot.errors import DatasetError, ImageError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.images import Image, ImageSource, StoredImage, write_image
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.datasets.dataset import Dataset
from panoloc_mcl.tools.datasets.reader import FORMAT
from panoloc_mcl.tools.datasets.tables import write_image_table
from panoloc_mcl.tools.datasets.trajectory import Trajectory, write_tum

MASK_FILE = "mask.png"


class DatasetWriter:
    """Writes a data set folder piece by piece; every file appears whole or not at all.

    ``dataset.yaml`` is written by :meth:`finish`, last of all, so that an interrupted write is not taken for a data set.

    Parameters
    ----------
    path : Path
        A folder that does not exist yet, or is empty.
    name, description, licence : str
    camera : AnyCamera
        Of all images in folders that get no camera of their own.
    resume : bool
        Go on in a folder that an earlier writer was stopped in.
    poses_of : str
        Whose poses those of the references are: ``base`` or ``camera``.

    Raises
    ------
    DatasetError
        The folder already holds something.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        camera: AnyCamera,
        description: str = "",
        licence: str = "",
        resume: bool = False,
        poses_of: Literal["base", "camera"] = "base",
    ) -> None:
        if not resume and path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise DatasetError(f"{path}: already exists and is not empty; choose another folder or remove it")
        self.path, self.name, self.camera = path, name, camera
        self.description, self.licence = description, licence
        self.poses_of = poses_of

    def add_references(
        self,
        images: Iterable[Image | None],
        poses: ArrayLike,
        camera: AnyCamera | None = None,
        names: Iterable[str] | None = None,
        sds: ArrayLike | None = None,
    ) -> None:
        """Write the reference images and ``poses.csv``.

        Parameters
        ----------
        images : iterable of ndarray or None
            8- or 16-bit, grey, BGR or BGRA; consumed one by one. None: the file is there already.
        poses : array_like of float, shape (n, 3)
        camera : AnyCamera, optional
            When it is another than the data set's.
        names : iterable of str, optional
            File names, PNG or JPEG by their ending; ``ref_000.png`` and so on if left out.
        sds : array_like of float, shape (n, 2), optional
            Standard deviations of the poses: x and y, metres, and heading, radians; NaN where unknown.

        Raises
        ------
        DatasetError, ImageError
            Files that cannot be written, or another number of images than poses.
        """
        table = np.asarray(poses, dtype=np.float64)
        files = list(names) if names is not None else [f"ref_{index:03d}.png" for index in range(len(table))]
        folder = self.path / "references"
        self._write_images(folder, files, images, len(table))
        _write_poses(folder, files, table, None if sds is None else np.asarray(sds, dtype=np.float64))
        _write_camera(folder, camera, self.camera)

    def add_sequence(
        self,
        name: str,
        times: ArrayLike,
        images: Iterable[Image | None],
        odometry: Trajectory | None = None,
        groundtruth: Trajectory | None = None,
        camera: AnyCamera | None = None,
        names: Iterable[str] | None = None,
    ) -> None:
        """Write one sequence; parameters as in :meth:`add_references`, times in seconds, shape (n,).

        Raises
        ------
        DatasetError, ImageError
            Files that cannot be written, or another number of images than times.
        """
        if not name or PurePosixPath(name).name != name or name.startswith("."):
            raise DatasetError(f"{self.path}: sequence name '{name}' is no folder name; use letters, digits and underscores")
        stamps = np.asarray(times, dtype=np.float64)
        files = list(names) if names is not None else [f"images/f{index:03d}.png" for index in range(len(stamps))]
        folder = self.path / "sequences" / name
        self._write_images(folder, files, images, len(stamps))
        rows = [(f"{time:.9f}", file) for time, file in zip(stamps, files, strict=True)]
        if odometry is not None:
            write_tum(folder / "odometry.tum", odometry)
        if groundtruth is not None:
            write_tum(folder / "groundtruth.tum", groundtruth)
        _write_camera(folder, camera, self.camera)
        write_image_table(folder / "frames.csv", ("timestamp", "file"), rows)

    def finish(self) -> Path:
        """Write ``dataset.yaml`` and return the folder."""
        data = {
            "format": FORMAT,
            "name": self.name,
            "description": self.description,
            "licence": self.licence,
            "camera": _mapping(self.path, self.camera),
        }
        if self.poses_of != "base":
            data["references"] = {"poses_of": self.poses_of}
        write_atomically(self.path / "dataset.yaml", dump_yaml(data))
        return self.path

    def _write_images(self, folder: Path, files: list[str], images: Iterable[Image | None], count: int) -> None:
        written = 0
        for written, image in enumerate(images, start=1):
            if written > min(count, len(files)):
                break
            if image is not None:
                write_image(folder / files[written - 1], image)
        if not written == count == len(files):
            raise DatasetError(f"{folder}: {written} images, {len(files)} file names and {count} rows; must be as many of each")


def copy_dataset(dataset: Dataset, path: Path) -> Path:
    """Write a data set that was read, from whatever layout, into a folder of this layout; image files are copied as they are.

    Raises
    ------
    DatasetError
        The folder is not empty, or a file cannot be written.
    """
    references = dataset.references
    writer = DatasetWriter(
        path, dataset.name, dataset.camera, dataset.description, dataset.licence, poses_of=references.poses_of
    )
    if len(references):
        names = _copy_images(references.path, references.files, path / "references")
        _write_poses(path / "references", names, references.poses, references.sds)
        _write_camera(path / "references", references.camera, dataset.camera)
    for sequence in dataset.sequences.values():
        folder = path / "sequences" / sequence.name
        names = _copy_images(sequence.path, sequence.files, folder)
        for file, trajectory in (("odometry.tum", sequence.odometry), ("groundtruth.tum", sequence.groundtruth)):
            if trajectory is not None:
                write_tum(folder / file, trajectory)
        _write_camera(folder, sequence.camera, dataset.camera)
        stamps = [(f"{time:.9f}", name) for time, name in zip(sequence.times, names, strict=True)]
        write_image_table(folder / "frames.csv", ("timestamp", "file"), stamps)
    return writer.finish()


def _write_poses(folder: Path, files: list[str], poses: NDArray[np.float64], sds: NDArray[np.float64] | None) -> None:
    columns: tuple[str, ...] = ("file", "x", "y", "theta")
    table = poses
    if sds is not None:
        columns, table = (*columns, "sd_xy", "sd_theta"), np.column_stack([poses, sds])
        # A heading that is not known is none.
        table[np.isinf(table[:, 4])[:, None] & np.array([False, False, True, False, True])] = np.nan
    rows = [
        (file, *("" if np.isnan(value) else repr(float(value)) for value in row))
        for file, row in zip(files, table, strict=True)
    ]
    write_image_table(folder / "poses.csv", columns, rows)


def _write_camera(folder: Path, camera: AnyCamera | None, common: AnyCamera) -> None:
    if camera is not None and camera != common:
        write_atomically(folder / "camera.yaml", dump_yaml(_mapping(folder, camera)))


def _mapping(folder: Path, camera: AnyCamera) -> dict[str, Any]:
    """A camera's mapping; its mask becomes a picture beside the file."""
    mapping = to_mapping(camera)
    if camera.mask is not None:
        write_atomically(folder / MASK_FILE, camera.mask.png())
        mapping["mask"] = MASK_FILE
    return mapping


def _copy_images(source: Path, files: tuple[ImageSource, ...], folder: Path) -> list[str]:
    names = []
    for index, file in enumerate(files):
        if not isinstance(file, Path):
            names.append(_write_stored(file, index, folder))
            continue
        inside = file.is_relative_to(source) and ".." not in file.parts
        name = file.relative_to(source).as_posix() if inside else f"images/{index:05d}_{file.name}"
        try:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, folder / name)
        except OSError as error:
            raise DatasetError(f"{folder / name}: cannot be written ({error.strerror}); check space and rights") from error
        names.append(name)
    return names


def _write_stored(image: StoredImage, index: int, folder: Path) -> str:
    """Write an image of a recording: a PNG or JPEG as it is, anything else as PNG; one that cannot be read as it stands there."""
    content = image.content()
    ending = next((ending for start, ending in _AS_THEY_ARE.items() if content.startswith(start)), None)
    name = f"images/{index:06d}{ending or '.png'}"
    if ending is not None:
        write_atomically(folder / name, content)
        return name
    try:
        write_image(folder / name, image.read())
    except ImageError:
        write_atomically(folder / name, content)
    return name


_AS_THEY_ARE = {b"\x89PNG\r\n\x1a\n": ".png", b"\xff\xd8\xff": ".jpg"}

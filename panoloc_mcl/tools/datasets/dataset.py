"""What a data set holds, whatever layout it was read from."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera.spec import AnyCamera
from panoloc_mcl.robot.errors import DatasetError, did_you_mean
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.datasets.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sequence:
    """The images of one drive.

    Parameters
    ----------
    name : str
        The folder's name.
    path : Path
        The folder.
    times : ndarray of float64, shape (n,)
        Seconds, strictly increasing, by the clock of odometry.
    files : tuple of Path or StoredImage
        One image a time.
    camera : AnyCamera
    image_size : (int, int)
        Width and height.
    odometry : Trajectory or None
        Poses in the odometry frame, with time stamps of their own.
    groundtruth : Trajectory or None
        True poses in the map frame.
    notes : tuple of str
        What the user should know of how it was read.
    """

    name: str
    path: Path
    times: FloatArray
    files: tuple[ImageSource, ...]
    camera: AnyCamera
    image_size: tuple[int, int]
    odometry: Trajectory | None = None
    groundtruth: Trajectory | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.files)

    def of(self, frames: ArrayLike) -> Sequence:
        """The same drive with some of its images only: ascending indices, int (m,)."""
        left = np.asarray(frames, dtype=np.int64)
        return replace(self, times=self.times[left], files=tuple(self.files[index] for index in left))


@dataclass(frozen=True, eq=False)
class Dataset:
    """References and sequences taken in one place.

    Parameters
    ----------
    name, description, licence : str
    path : Path
        The folder.
    camera : AnyCamera
        Of all images in folders without a camera of their own.
    references : References
    sequences : dict of str to Sequence
        By name, sorted; may be empty.
    """

    name: str
    path: Path
    description: str
    licence: str
    camera: AnyCamera
    references: References
    sequences: dict[str, Sequence] = field(default_factory=dict)

    def select(self, patterns: str | Iterable[str]) -> list[Sequence]:
        """Sequences by name.

        Parameters
        ----------
        patterns : str or iterable of str
            ``all``, or names or globs (``noon_*``); in the data set's order, none twice.

        Raises
        ------
        DatasetError
            A name or glob that fits no sequence, with the nearest names.
        """
        wanted = [patterns] if isinstance(patterns, str) else list(patterns)
        chosen: set[str] = set()
        faults = []
        for pattern in wanted:
            found = list(self.sequences) if pattern == "all" else fnmatch.filter(self.sequences, pattern)
            if not found:
                faults.append(f"{self.path}: sequences: '{pattern}' fits none{_suggest(pattern, list(self.sequences))}")
            chosen.update(found)
        if faults:
            raise DatasetError(faults)
        return [sequence for name, sequence in self.sequences.items() if name in chosen]


def _suggest(name: str, known: list[str]) -> str:
    there_are = f"there are: {', '.join(known)}" if known else "this data set has no sequences"
    return f"; {did_you_mean(name, known) or there_are}"

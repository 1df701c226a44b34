"""Images of a data set at known poses, corrupted or as they are, and what one of them tells by itself."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from panoloc_mcl.laboratory.corruptions import Recipe
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VoteField
from panoloc_mcl.tools.datasets import Dataset, read_image
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M, is_within
from panoloc_mcl.tools.evaluation.record import group_of

#: Metres and degrees of the tiers that single images are judged by.
TIERS = ((0.25, 3.0), (0.10, 1.0))


@dataclass(frozen=True, eq=False)
class Frame:
    """An image and where it was taken.

    Parameters
    ----------
    number : int
        Its position in the data set, for the random numbers.
    drive : Sequence
    index : int
        Its position in the drive.
    truth : float64 (3,)
    """

    number: int
    drive: Drive
    index: int
    truth: FloatArray

    @property
    def file(self) -> ImageSource:
        """The image."""
        return self.drive.files[self.index]

    @property
    def name(self) -> str:
        """Drive and file."""
        return f"{self.drive.name}/{self.file.name}"

    @property
    def group(self) -> str:
        """What the drive's name begins with: its light."""
        return group_of(self.drive.name)


def frames_of(dataset: Dataset, every: int = 1, selection: str | Sequence[str] = "all") -> dict[str, list[Frame]]:
    """Every so many images with ground truth, by group of sequences.

    Raises
    ------
    DatasetError
        There are none.
    """
    wanted = {drive.name for drive in dataset.select(selection if isinstance(selection, str) else list(selection))}
    frames: dict[str, list[Frame]] = {}
    before = 0
    for drive in dataset.sequences.values():
        if drive.groundtruth is not None and drive.name in wanted:
            # Not the first: drives may all begin at a reference.
            chosen = range(min(every // 2, len(drive) - 1), len(drive), every)
            truth = drive.groundtruth.at(drive.times)
            frames.setdefault(group_of(drive.name), []).extend(Frame(before + i, drive, i, truth[i]) for i in chosen)
        before += len(drive)
    if not frames:
        raise DatasetError(f"{dataset.path}: has no sequence with ground truth among those selected; use another data set")
    return frames


class Viewer:
    """Reads images as the panoramas that a map compares, corrupted where that is wanted.

    Parameters
    ----------
    panorama_map : PanoramaMap
    seed : int
        Of the corruptions: with the same seed every model sees the same images.
    """

    def __init__(self, panorama_map: PanoramaMap, seed: int = 0) -> None:
        self._map, self._seed = panorama_map, seed
        self._unwrappers = {}  # type: ignore[var-annotated]

    def panorama(self, frame: Frame, recipe: Recipe | None = None) -> Panorama:
        """One image."""
        drive = frame.drive
        key = drive.camera, drive.image_size
        unwrap = self._unwrappers.get(key) or self._map.unwrapper(*key)
        self._unwrappers[key] = unwrap
        panorama: Panorama = unwrap(read_image(frame.file))
        if recipe is None:
            return panorama
        rng = np.random.default_rng([self._seed, frame.number, zlib.crc32(recipe.text.encode())])
        return recipe.panorama(panorama, rng, self._map.geometry.elevation_deg)


@dataclass(frozen=True)
class Verdict:
    """How right a model is about one image.

    Parameters
    ----------
    drive, name : str
        Where the image is from.
    position_m, heading_deg : float
        Errors; infinite where the model finds that the image says nothing.
    nearest : bool
        The reference that it names is the nearest one.
    passes : bool
        The image was taken within 0.15 m of a reference.
    """

    drive: str
    name: str
    position_m: float
    heading_deg: float
    nearest: bool
    passes: bool

    @classmethod
    def of(cls, frame: Frame, votes: VoteField, references: FloatArray, *, refined: bool = True) -> Self:
        """Hold a vote field against the truth.

        Parameters
        ----------
        frame : Frame
        votes : VoteField
        references : float64 (n, 2)
            Where they were truly taken.
        refined : bool
            Judge the measurement, where there is one, and not the best pose of the votes.
        """
        pose = votes.measurement.pose if refined and votes.measurement is not None else votes.best_pose
        apart = np.hypot(*(references - frame.truth[:2]).T)
        # A model of the references alone names one; others give a pose, and the reference nearest to it.
        named = votes.peak.place if votes.places.references is None else votes.places.nearest_reference(pose[:2])
        says = votes.informative
        return cls(
            frame.drive.name,
            frame.name,
            float(np.hypot(*(pose - frame.truth)[:2])) if says else np.inf,
            float(np.degrees(abs(angle_difference(pose[2], frame.truth[2])))) if says else np.inf,
            # By distance, not by index: references taken at one spot are one place.
            says and bool(apart[named] <= apart.min() + 1e-9),
            bool(apart.min() <= PASS_RADIUS_M),
        )

    def within(self, metres: float, degrees: float) -> bool:
        """Both errors are at most so large."""
        return bool(is_within(np.array([self.position_m]), np.array([self.heading_deg]), metres, degrees)[0])


def counted(frames: dict[str, list[Frame]]) -> str:
    """How many drives and images there are, in words."""
    drives = {frame.drive.name for some in frames.values() for frame in some}
    return f"{len(drives)} drives, {sum(map(len, frames.values()))} images"

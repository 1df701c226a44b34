"""Writes a data set with imperfections: a data set like any other."""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.corruptions.draft import Draft, Folder, Shot, View, draft_of
from panoloc_mcl.laboratory.corruptions.lens import levels_of, light_of
from panoloc_mcl.laboratory.corruptions.recipe import Recipe
from panoloc_mcl.laboratory.corruptions.sight import Sight, sight_of
from panoloc_mcl.robot.camera.spec import PanoramaCamera
from panoloc_mcl.robot.errors import ConfigError, DatasetError
from panoloc_mcl.robot.images import Image, read_image
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets.writer import DatasetWriter

# Grey levels by which two images of one pose differ: the noise of a good camera.
_NOISE_OF_COPIES = 1.0
# Of a camera of which nobody says how high it stands.
_USUAL_HEIGHT_M = 0.6


def corrupt(
    dataset: Dataset,
    recipe: Recipe,
    seed: int,
    path: Path,
    sequences: str | Iterable[str] = "all",
    progress: Progress = no_progress,
) -> Path:
    """Write a data set as it would be had it been recorded less perfectly.

    Parameters
    ----------
    dataset : Dataset
    recipe : Recipe
    seed : int
        Of all that is drawn. An image comes out the same whichever sequences are written with it.
    path : Path
        A folder that does not exist yet, or is empty.
    sequences : str or iterable of str
        Names or globs of those to write; ``along_drive`` takes its references from the others, or else from these.
    progress : callable, optional

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    ConfigError
        The recipe needs something that this data set has not.
    DatasetError, ImageError
        Files that cannot be read or written.
    """
    draft = draft_of(dataset, [drive.name for drive in dataset.select(sequences)])
    if not draft.spare and len(draft.drives) > 1 and any(use.name == "along_drive" for use in recipe.uses):
        draft.spare[min(draft.drives)] = draft.drives.pop(min(draft.drives))
    for use in recipe.uses:
        use.apply(draft, np.random.default_rng((seed, zlib.crc32(use.name.encode()))), recipe.told)
    for name, drive in draft.drives.items():
        left = recipe.frames(len(drive.shots), np.random.default_rng((seed, zlib.crc32(name.encode()))))
        drive.shots = [drive.shots[index] for index in left]
    return _Pictures(draft, recipe, seed, progress).write(dataset, path)


class _Pictures:
    """Makes the images of a draft one by one."""

    def __init__(self, draft: Draft, recipe: Recipe, seed: int, progress: Progress) -> None:
        self._draft, self._recipe, self._seed, self._progress = draft, recipe, seed, progress
        self._total = sum(len(folder.shots) for folder in draft.folders)
        self._done = 0

    def write(self, dataset: Dataset, path: Path) -> Path:
        draft = self._draft
        said = f"{dataset.description}; {self._recipe.text}, seed {self._seed}".removeprefix("; ")
        references = draft.references
        writer = DatasetWriter(path, dataset.name, references.camera, said, dataset.licence, poses_of=draft.poses_of)
        names = self._names(references, "ref_{:03d}", of_references=True)
        images = self._images(references, path / "references", names, of_references=True)
        writer.add_references(images, references.claimed, references.camera, names, references.sds)
        for name, drive in draft.drives.items():
            names = self._names(drive, "images/f{:03d}", of_references=False)
            images = self._images(drive, path / "sequences" / name, names, of_references=False)
            times = [shot.time for shot in drive.shots]
            writer.add_sequence(name, times, images, drive.odometry, drive.groundtruth, drive.camera, names)
        return writer.finish()

    def _names(self, folder: Folder, pattern: str, of_references: bool) -> list[str]:
        return [
            pattern.format(index) + (shot.file.suffix.lower() if self._stays(folder, shot, of_references) else ".png")
            for index, shot in enumerate(folder.shots)
        ]

    def _stays(self, folder: Folder, shot: Shot, of_references: bool) -> bool:
        return not (folder.disturbances or shot.copy or shot.turned or (self._recipe.changes_images and not of_references))

    def _images(self, folder: Folder, target: Path, names: list[str], of_references: bool) -> Iterator[Image | None]:
        sight = sight_of(folder.optics, folder.size)
        for shot, name in zip(folder.shots, names, strict=True):
            image: Image | None = None
            if self._stays(folder, shot, of_references):
                _copy(shot.file, target / name)
            else:
                image = self._image(folder, shot, sight, of_references)
            yield image
            self._done += 1
            self._progress(self._done, self._total, "images")

    def _image(self, folder: Folder, shot: Shot, sight: Sight, of_references: bool) -> Image:
        key = (self._seed, zlib.crc32(f"{shot.file.parent.parent.name}/{shot.file.name}".encode()), shot.copy)
        light = light_of(np.roll(read_image(shot.file), shot.turned, axis=1) if shot.turned else read_image(shot.file))
        height = folder.optics.height_m or _USUAL_HEIGHT_M
        for name, disturb in folder.disturbances:
            own = zlib.crc32(name.encode())
            rng = np.random.default_rng((*key, own))
            light = disturb(light, View(sight, shot.pose, height, shot.time, of_references, rng, (self._seed, own)))
        if not sight.seen.all():
            light = np.where(sight.seen[..., None], light, np.float32(0.0))
        levels = levels_of(light)
        if shot.copy:
            noise = np.random.default_rng((*key, 1)).normal(0.0, _NOISE_OF_COPIES, levels.shape)
            levels = np.clip(np.rint(levels + noise), 0, 255).astype(np.uint8)
        if self._recipe.changes_images and not of_references:
            if not isinstance(folder.optics, PanoramaCamera):
                raise ConfigError(f"corruption '{self._recipe.text}': has a step that is for panoramas alone; leave it out")
            levels = self._recipe.image(levels, np.random.default_rng((*key, 2)), folder.optics.elevation_deg)
        return levels


def _copy(source: Path, target: Path) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    except OSError as error:
        raise DatasetError(f"{target}: cannot be written ({error.strerror}); check space and rights") from error

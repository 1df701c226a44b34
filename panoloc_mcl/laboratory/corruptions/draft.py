"""A data set on its way to be written: what each image shows, from where and when, apart from what is claimed of it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.corruptions.sight import Sight
from panoloc_mcl.robot.camera.spec import AnyCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets.trajectory import Trajectory

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Luminance is grey level to this power.
GAMMA = 2.2


@dataclass(frozen=True, eq=False)
class View:
    """What a disturbance may know of the image that it is given.

    Parameters
    ----------
    sight : Sight
    pose : float64 (3,) or None
        Where the camera truly was, map frame; None where nobody knows.
    height_m : float
        Of the camera above the floor.
    time : float
        Seconds; references have none, 0.
    of_reference : bool
    rng : Generator
        Of this image alone: it is the same whichever other images are there.
    fixed_key : tuple of int
        Seeds what the disturbance draws for all images alike.
    """

    sight: Sight
    pose: Float64 | None
    height_m: float
    time: float
    of_reference: bool
    rng: np.random.Generator
    fixed_key: tuple[int, ...]

    def fixed(self, *part: int) -> np.random.Generator:
        """A generator that is the same for all images, so that what it draws stays with the camera or with a part of the world."""
        return np.random.default_rng((*self.fixed_key, *part))


#: Light in, light out: float32 (rows, columns, channels), linear, 1 where the camera is full; more is light that it cannot show.
Disturbance = Callable[[Float32, View], Float32]


@dataclass(frozen=True, eq=False)
class Shot:
    """One image to be written.

    Parameters
    ----------
    file : Path
        The image that it is made of.
    pose : float64 (3,) or None
        True pose of the camera.
    time : float
        When it was taken.
    copy : int
        Counts images made of one file: each gets its own noise.
    turned : int
        Columns that the panorama is turned by, to the right.
    """

    file: Path
    pose: Float64 | None
    time: float = 0.0
    copy: int = 0
    turned: int = 0


@dataclass
class Folder:
    """The references or one drive.

    Parameters
    ----------
    shots : list of Shot
    optics : AnyCamera
        The camera as it truly is.
    size : (int, int)
    camera : AnyCamera
        As it will be claimed to be.
    claimed : float64 (n, 3)
        References: poses as they will be written.
    sds : float64 (n, 2) or None
        References: what is said of their errors, metres and radians.
    odometry, groundtruth : Trajectory or None
        Of a drive.
    disturbances : list of (name, Disturbance)
        In the order in which light meets them.
    """

    shots: list[Shot]
    optics: AnyCamera
    size: tuple[int, int]
    camera: AnyCamera
    claimed: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    sds: Float64 | None = None
    odometry: Trajectory | None = None
    groundtruth: Trajectory | None = None
    disturbances: list[tuple[str, Disturbance]] = field(default_factory=list)


@dataclass
class Draft:
    """A data set to be written, changed by one imperfection after the other.

    Parameters
    ----------
    references : Folder
    drives : dict of str to Folder
        By name.
    spare : dict of str to Folder
        Drives that are not to be written.
    poses_of : str
        What the claimed poses of the references are of: ``base`` or ``camera``.
    """

    references: Folder
    drives: dict[str, Folder]
    spare: dict[str, Folder]
    poses_of: Literal["base", "camera"] = "base"

    @property
    def folders(self) -> list[Folder]:
        """References first."""
        return [self.references, *self.drives.values()]

    def of(self, where: str) -> list[Folder]:
        """Folders by a word: ``both``, ``references`` or ``drives``."""
        return {"both": self.folders, "references": [self.references], "drives": list(self.drives.values())}[where]


def draft_of(dataset: Dataset, wanted: Collection[str] | None = None) -> Draft:
    """A data set as it is, with the wanted drives; all if left out."""
    source = dataset.references
    taken = source.poses if source.poses_of == "camera" else _of_camera(source.poses, source.camera)
    references = Folder(
        [Shot(_own_file(file), pose) for file, pose in zip(source.files, taken, strict=True)],
        source.camera,
        source.image_size,
        source.camera,
        claimed=source.poses.copy(),
        sds=source.sds,
    )
    drives = {}
    for name, drive in dataset.sequences.items():
        truth = None if drive.groundtruth is None else _of_camera(drive.groundtruth.at(drive.times), drive.camera)
        shots = [
            Shot(_own_file(file), None if truth is None else truth[index], float(time))
            for index, (file, time) in enumerate(zip(drive.files, drive.times, strict=True))
        ]
        drives[name] = Folder(
            shots,
            drive.camera,
            drive.image_size,
            drive.camera,
            odometry=drive.odometry,
            groundtruth=drive.groundtruth,
        )
    chosen = drives if wanted is None else {name: drives[name] for name in drives if name in wanted}
    return Draft(references, chosen, {name: drives[name] for name in drives if name not in chosen}, source.poses_of)


def _of_camera(base: Float64, camera: AnyCamera) -> Float64:
    """Poses of the camera on bases at poses (n, 3)."""
    mount = camera.mounting
    return compose(base, np.array([mount.x_m, mount.y_m, mount.yaw]))


def _own_file(image: ImageSource) -> Path:
    if not isinstance(image, Path):
        raise DatasetError(f"{image}: lies in a recording; write a data set of it first: panoloc convert")
    return image


def moved(trajectory: Trajectory | None, poses: Callable[[Float64], Float64]) -> Trajectory | None:
    """The same trajectory with other poses."""
    return None if trajectory is None else replace(trajectory, poses=poses(trajectory.poses))

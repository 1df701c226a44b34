"""Robots that are carried away: put down where any image of the map's area was taken, turned by any angle, odometry silent."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.through import SeenThrough
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import Trajectory

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Kidnapped:
    """A robot that is carried away again and again.

    Parameters
    ----------
    drive : Sequence
        Its images as they were taken, its odometry and its true poses, turned.
    carried : bool (n,)
        Images that are the first after a teleport.
    turns : int64 (n,)
        Columns by which the panorama of each image is to be turned.
    """

    drive: Drive
    carried: NDArray[np.bool_]
    turns: NDArray[np.int64]


def kidnapped(drives: Sequence[Drive], stretch: int, columns: int, rng: np.random.Generator) -> Kidnapped:
    """Stretches of so many images, each from a uniformly drawn image and turned by a uniformly drawn angle, one after the other.

    A stretch follows its drive from that image on, or backwards where less of it is left. There are as many stretches as whole ones
    fit into the drives.

    Parameters
    ----------
    drives : sequence of Sequence
        With odometry and ground truth, and of one camera.
    stretch : int
        Images.
    columns : int
        Of a panorama.
    rng : numpy.random.Generator

    Raises
    ------
    DatasetError
        A drive without odometry or truth, or none of so many images.
    """
    drives = [drive for drive in drives if len(drive) >= stretch]
    if not drives or any(drive.odometry is None or drive.groundtruth is None for drive in drives):
        raise DatasetError(
            f"kidnaps need drives of at least {stretch} images with odometry and ground truth; use another data set"
        )
    ends = np.cumsum([len(drive) for drive in drives])
    files: list[ImageSource] = []
    times, truth, turns, odometry = [], [], [], []
    clock, standing = 0.0, np.zeros(3)
    for drawn in rng.integers(ends[-1], size=ends[-1] // stretch):
        number = int(np.searchsorted(ends, drawn, side="right"))
        drive, index = drives[number], int(drawn) - (int(ends[number]) - len(drives[number]))
        frames = index + np.arange(stretch) if index + stretch <= len(drive) else index - np.arange(stretch)
        frames -= min(int(frames.min()), 0)
        turn = int(rng.integers(columns))
        turned = np.array([0.0, 0.0, -2.0 * np.pi * turn / columns])
        assert drive.odometry is not None
        assert drive.groundtruth is not None
        begin, end = float(drive.times[frames[0]]), float(drive.times[frames[-1]])
        inside = (drive.odometry.times > min(begin, end)) & (drive.odometry.times < max(begin, end))
        stamps = np.unique(np.concatenate([drive.times[frames], drive.odometry.times[inside]]))
        stamps = stamps if end > begin else stamps[::-1]
        driven = compose(drive.odometry.at(stamps), turned)
        driven = compose(standing, between(driven[0], driven))
        odometry.append(Trajectory(clock + np.abs(stamps - begin), driven))
        standing = driven[-1]
        times.append(clock + np.abs(drive.times[frames] - begin))
        truth.append(compose(drive.groundtruth.at(drive.times[frames]), turned))
        turns.append(np.full(stretch, turn))
        files += [drive.files[frame] for frame in frames]
        clock = float(times[-1][-1]) + float(np.median(np.diff(drive.times)))
    stamps = np.concatenate(times)
    carried = np.arange(len(stamps)) % stretch == 0
    carried[0] = False
    drive = replace(
        drives[0],
        times=stamps,
        files=tuple(files),
        odometry=Trajectory(np.concatenate([way.times for way in odometry]), np.concatenate([way.poses for way in odometry])),
        groundtruth=Trajectory(stamps, np.concatenate(truth)),
    )
    return Kidnapped(drive, carried, np.concatenate(turns))


class Turned(SeenThrough):
    """An observation model that sees each panorama as a robot that is turned; images come in the order of the turns.

    Parameters
    ----------
    model : ObservationModel
    turns : iterable of int
        Columns, for each image.
    """

    def __init__(self, model: ObservationModel, turns: Iterable[int]) -> None:
        super().__init__(model)
        self._turns = iter(turns)

    def seen(self, panorama: Panorama) -> Panorama:
        """Turned."""
        shift = -int(next(self._turns))
        valid = None if panorama.valid is None else np.roll(panorama.valid, shift, axis=1)
        return Panorama(np.roll(panorama.pixels, shift, axis=1), valid)

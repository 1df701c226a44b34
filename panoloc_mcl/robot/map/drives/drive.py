"""Drives as a map is made of: which images become keyframes, and what odometry says of the way between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Camera
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.geometry import angle_difference, between
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Edges

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# What odometry of wheels errs by between two keyframes: a share of the way and of the turn, a drift with the way, and a little always.
# Generous: images say far better, and odometry only has to bridge where they say nothing.
_WAY, _TURN, _DRIFT = 0.1, 0.1, np.radians(2.0)
_ALWAYS_M, _ALWAYS_RAD = 0.02, np.radians(0.5)
# No robot gets on faster; a step that says so is a jump of odometry, and nothing is known of the way.
_FASTEST_M_S, _FASTEST_RAD_S = 3.0, 2.0 * np.pi
_LEAST_JUMP_M, _LEAST_JUMP_RAD = 0.5, np.radians(60.0)
_UNKNOWN_M, _UNKNOWN_RAD = 1.0, np.radians(45.0)
# Odometry that moves by less stands still.
_NO_WAY_M, _NO_TURN_RAD = 1e-3, np.radians(0.05)
# Odometry of a drive that stays within this did not move.
_LEAST_WAY_M = 0.4


@dataclass(frozen=True, eq=False)
class Drive:
    """Images of one drive with odometry.

    Parameters
    ----------
    name : str
    files : tuple of Path or StoredImage
    times : float64 (n,)
        Seconds, by the clock of odometry.
    odometry : float64 (n, 3)
        Poses of the robot's base at these times, in the frame of odometry; metres and radians.
    camera : Camera
    image_size : (int, int)
        Width and height.
    doubted : frozenset of int
        Images to which the way from the image before is not known, whatever odometry says.
    """

    name: str
    files: tuple[ImageSource, ...]
    times: Float64
    odometry: Float64
    camera: Camera
    image_size: tuple[int, int]
    doubted: frozenset[int] = frozenset()

    def of(self, kept: Int64) -> Drive:
        """With some of its images only."""
        # What cannot be trusted lies between those kept around it.
        doubted = np.searchsorted(kept, sorted(self.doubted))
        return replace(
            self,
            files=tuple(self.files[index] for index in kept),
            times=self.times[kept],
            odometry=self.odometry[kept],
            doubted=frozenset(int(index) for index in doubted if index < len(kept)),
        )

    def at(self, poses: Float64) -> Drive:
        """With other poses (n, 3) than those of odometry."""
        return replace(self, odometry=poses)

    def stands(self) -> Int64:
        """Images before which odometry did not move at all, since the image before."""
        step = between(self.odometry[:-1], self.odometry[1:])
        return 1 + np.flatnonzero((np.hypot(step[:, 0], step[:, 1]) < _NO_WAY_M) & (np.abs(step[:, 2]) < _NO_TURN_RAD))

    def unknown(self) -> NDArray[np.bool_]:
        """Steps that odometry says nothing about: jumps, and those doubted, bool (n - 1,)."""
        unknown = self.jumps()
        unknown[[index - 1 for index in self.doubted if index > 0]] = True
        return unknown

    def jumps(self) -> NDArray[np.bool_]:
        """Steps between images that no robot can make, bool (n - 1,)."""
        step = between(self.odometry[:-1], self.odometry[1:])
        seconds = np.diff(self.times)
        far = np.hypot(step[:, 0], step[:, 1]) > np.maximum(_FASTEST_M_S * seconds, _LEAST_JUMP_M)
        return np.asarray(far | (np.abs(step[:, 2]) > np.maximum(_FASTEST_RAD_S * seconds, _LEAST_JUMP_RAD)))

    def edges(self, first: int) -> Edges:
        """What odometry says between images one after the other; the first of them is keyframe ``first``."""
        step = between(self.odometry[:-1], self.odometry[1:])
        way, turn = np.hypot(step[:, 0], step[:, 1]), np.abs(step[:, 2])
        position = np.where(self.unknown(), _UNKNOWN_M, _ALWAYS_M + _WAY * way)
        heading = np.where(self.unknown(), _UNKNOWN_RAD, _ALWAYS_RAD + _TURN * turn + _DRIFT * way)
        covariances = np.einsum("mi,ij->mij", np.column_stack([position, position, heading]) ** 2, np.eye(3))
        pairs = first + np.column_stack([np.arange(len(step)), np.arange(1, len(step) + 1)])
        return Edges.of(pairs, step, covariances, ODOMETRY)


def check_drives(drives: Sequence[Drive]) -> tuple[str, ...]:
    """What the user should know of drives before they become a map.

    Raises
    ------
    MapError
        No drive, cameras that differ, no height of the camera, or a drive on which the robot hardly moved.
    """
    if not drives:
        raise MapError("a map needs at least one drive; name one with --drives")
    first = drives[0]
    faults = []
    for drive in drives:
        if drive.camera != first.camera or drive.image_size != first.image_size:
            faults.append(f"drive {drive.name}: has another camera than {first.name}; make a map of each")
        if np.hypot(*np.ptp(drive.odometry[:, :2], axis=0)) < _LEAST_WAY_M:
            faults.append(f"drive {drive.name}: by its odometry the robot hardly moved; a map needs a drive through the place")
    if first.camera.height_m is None:
        faults.append(f"drive {first.name}: the camera's height gives the map its scale; give camera.height_m in dataset.yaml")
    if faults:
        raise MapError(faults)
    return tuple(line for drive in drives for line in _said(drive))


def _said(drive: Drive) -> Iterator[str]:
    jumps = np.flatnonzero(drive.jumps())
    if len(jumps):
        step = drive.odometry[jumps[0] + 1] - drive.odometry[jumps[0]]
        yield (
            f"drive {drive.name}: odometry jumps {len(jumps)} times, first at {drive.times[jumps[0]]:.3f} s by "
            f"{np.hypot(*step[:2]):.2f} m and {np.degrees(abs(angle_difference(step[2], 0.0))):.0f} degrees; images bridge it"
        )

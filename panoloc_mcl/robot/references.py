"""The references of a map: images of known places on disk, and the panoramas that they become, all of one size and at heading 0."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Camera, Panorama, PanoramaGeometry, Unwrapper, geometry_of
from panoloc_mcl.robot.camera.panorama import shifted
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import compose, wrap_angle
from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.robot.progress import Progress, no_progress


@dataclass(frozen=True, eq=False)
class References:
    """The images of known places that a map is made of.

    Parameters
    ----------
    path : Path
        The folder.
    files : tuple of Path or StoredImage
        One image a place.
    poses : ndarray of float64, shape (n, 3)
        Where each was taken, map frame: the robot's base, or the camera.
    camera : AnyCamera
        The camera of these images.
    image_size : (int, int)
        Their width and height.
    poses_of : str
        ``base`` or ``camera``.
    sds : ndarray of float64, shape (n, 2), optional
        Standard deviations of position (each axis, metres) and heading (radians); NaN where nobody says; that of a heading that
        is not known at all is without end.
    rows : (int, int), optional
        First row to use of the panoramas, and the one after the last; all if left out.
    tall : bool
        Depths are told by all of these rows, not only by those in which floors and walls stand in any room.
    """

    path: Path
    files: tuple[ImageSource, ...]
    poses: NDArray[np.float64]
    camera: Camera
    image_size: tuple[int, int]
    poses_of: Literal["base", "camera"] = "base"
    sds: NDArray[np.float64] | None = None
    rows: tuple[int, int] | None = None
    tall: bool = False

    @property
    def geometry(self) -> PanoramaGeometry:
        """Of the panoramas that they become."""
        whole = geometry_of(self.camera, self.image_size)
        return whole if self.rows is None else whole.of_rows(*self.rows)

    @property
    def base_headings(self) -> NDArray[np.float64]:
        """Headings of the robot's base, radians (n,)."""
        turned = self.camera.mounting.yaw if self.poses_of == "camera" else 0.0
        return self.poses[:, 2] - turned

    @property
    def camera_positions(self) -> NDArray[np.float64]:
        """Where the camera stood, metres (n, 2), map frame."""
        if self.poses_of == "camera" or self.camera.mount is None:
            return np.ascontiguousarray(self.poses[:, :2])
        return np.ascontiguousarray(compose(self.poses, self.camera.mount.offset)[:, :2])

    @property
    def standpoints(self) -> NDArray[np.float64]:
        """Where the camera stood, and the heading of the base: float64 (n, 3), what a panorama of the map shows."""
        return np.column_stack([self.camera_positions, wrap_angle(self.base_headings)])

    def moved_to(self, standpoints: NDArray[np.float64]) -> References:
        """The same images with poses that give these standpoints (n, 3)."""
        poses = np.array(standpoints, dtype=np.float64)
        if self.poses_of == "camera":
            poses[:, 2] = wrap_angle(poses[:, 2] + self.camera.mounting.yaw)
        else:
            poses = self.camera.mounting.base_poses(poses)
        return replace(self, poses=poses)

    def of(self, indices: NDArray[np.int64]) -> References:
        """Some of the references."""
        return replace(
            self,
            files=tuple(self.files[index] for index in indices),
            poses=self.poses[indices],
            sds=None if self.sds is None else self.sds[indices],
        )

    def __len__(self) -> int:
        return len(self.files)


# What is made of references is another thing in another version.
_DIGEST = "panoloc-references/1"
# Panoramas that would be turned by less, in columns, stay as they are.
_SAME_COLUMNS = 1e-3


class Recorded(Protocol):
    """What a map is built from: a data set with references."""

    @property
    def name(self) -> str:
        """What to call the map."""

    @property
    def references(self) -> References:
        """The images of known places."""


@dataclass(frozen=True, eq=False)
class ReferencePanoramas:
    """Reference panoramas, upright, as the camera would have seen them with the base at heading 0.

    Parameters
    ----------
    pixels : uint8 (n, rows, columns)
        Grey levels.
    valid : bool (n, rows, columns), or None
        Pixels in which each reference shows the world, where not all do: a mask is fixed to the camera, so references taken at
        other headings miss other parts of the circle. A read-only view of one (rows, columns) where all miss the same.
    positions : float64 (n, 2)
        Where the camera stood, metres, map frame.
    names : tuple of str
        File names, for messages.
    geometry : PanoramaGeometry
    camera_height_m : float or None
        Of the camera above the floor.
    sds : float64 (n, 2), optional
        Standard deviations that the map claims of their poses: of the position, metres, and of the heading, radians.
    tall : bool
        As in `References`.
    """

    pixels: NDArray[np.uint8]
    valid: NDArray[np.bool_] | None
    positions: NDArray[np.float64]
    names: tuple[str, ...]
    geometry: PanoramaGeometry
    camera_height_m: float | None
    sds: NDArray[np.float64] | None = None
    tall: bool = False

    def __len__(self) -> int:
        return len(self.pixels)

    def digest(self, further: str, *arrays: NDArray[Any]) -> str:
        """Names their content, what is known of them, and whatever further text and arrays: equal ones have equal ones."""
        digest = hashlib.sha256(f"{_DIGEST} {self.geometry} {self.camera_height_m} {self.tall} {further}".encode())
        for array in (self.pixels, self.positions, self.valid, self.sds, *arrays):
            digest.update(b"" if array is None else np.ascontiguousarray(array).data)
        return digest.hexdigest()

    def panorama(self, index: int) -> Panorama:
        """One reference as a panorama."""
        return Panorama(self.pixels[index].astype(np.float32), None if self.valid is None else self.valid[index])

    def of(self, indices: NDArray[np.int64]) -> ReferencePanoramas:
        """Some of the references; all in their order are not copied."""
        if len(indices) == len(self) and np.array_equal(indices, np.arange(len(self))):
            return self
        return replace(
            self,
            pixels=self.pixels[indices],
            valid=None if self.valid is None else self.valid[indices],
            positions=self.positions[indices],
            names=tuple(self.names[index] for index in indices),
            sds=None if self.sds is None else self.sds[indices],
        )


def turned(references: ReferencePanoramas, angles: NDArray[np.float64]) -> ReferencePanoramas:
    """References whose headings are by so much larger (n,), radians, than they were thought to be when they were turned to heading 0.

    Columns are shifted by their spectrum, which blurs nothing, however often it is done.
    """
    # Azimuth falls with the column.
    columns = references.geometry.width
    shifts = np.asarray(angles) * columns / (2.0 * np.pi)
    pixels = references.pixels.copy()
    for index in np.flatnonzero(np.abs(shifts) > _SAME_COLUMNS):
        pixels[index] = np.clip(np.rint(shifted(references.pixels[index], -shifts[index])), 0, 255)
    valid = references.valid
    if valid is not None:
        valid = np.stack([np.roll(mask, -round(shift), axis=1) for mask, shift in zip(valid, shifts, strict=True)])
    return replace(references, pixels=pixels, valid=valid)


def read_references(source: References, progress: Progress = no_progress) -> ReferencePanoramas:
    """Read references as canonical panoramas at heading 0.

    Raises
    ------
    DatasetError, ImageError
        No references, or images that cannot be used.
    """
    if len(source) == 0:
        raise DatasetError(f"{source.path}: no references; a map needs at least one row in poses.csv")
    geometry = source.geometry
    pixels = np.empty((len(source), *geometry.shape), dtype=np.uint8)
    seen: list[NDArray[np.bool_] | None] = []
    unwrappers: dict[float, Unwrapper] = {}
    for index, (file, heading) in enumerate(zip(source.files, source.base_headings, strict=True)):
        turn = -float(heading)
        unwrap = unwrappers.get(turn) or Unwrapper(source.camera, source.image_size, geometry, turn)
        if len(unwrappers) < 4:
            # References usually share one heading; where each has its own, tables would only fill memory.
            unwrappers[turn] = unwrap
        panorama = unwrap(read_image(file))
        pixels[index] = np.clip(np.rint(panorama.pixels), 0, 255)
        seen.append(panorama.valid)
        progress(index + 1, len(source), "references")
    return ReferencePanoramas(
        pixels=pixels,
        valid=_stacked(seen, geometry.shape),
        positions=source.camera_positions,
        names=tuple(file.name for file in source.files),
        geometry=geometry,
        camera_height_m=source.camera.height_m,
        tall=source.tall,
    )


def _stacked(seen: list[NDArray[np.bool_] | None], shape: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Masks of all references (n, rows, columns); one that all share takes the room of one."""
    if all(mask is None for mask in seen):
        return None
    masks = [np.ones(shape, dtype=np.bool_) if mask is None else mask for mask in seen]
    if all(mask is masks[0] or np.array_equal(mask, masks[0]) for mask in masks):
        return np.broadcast_to(masks[0], (len(masks), *shape))
    return np.stack(masks)

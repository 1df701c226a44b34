"""Renders panoramas of the room as a camera with fixed exposure would take them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from oracles.furnished_room.light import FloatImage, Light, bake
from oracles.furnished_room.scene import Box, Room, face_size

from panoloc_mcl.robot.camera.panorama import PanoramaGeometry

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_SAMPLES = 2  # along each axis of a pixel
_LEVELS = 4  # of ever coarser textures, against aliasing far away
_FULL_WELL = 6000.0  # electrons at full scale
_READ_NOISE = 8.0  # electrons
_GAMMA = 2.2


class RoomRenderer:
    """A panoramic camera in a room under one light.

    Parameters
    ----------
    room : Room
    light : Light
    geometry : PanoramaGeometry
    height_m : float
        Of the camera above the floor.
    """

    def __init__(self, room: Room, light: Light, geometry: PanoramaGeometry, height_m: float = 0.6) -> None:
        self.room, self.geometry, self.height_m = room, geometry, height_m
        self._boxes = (room.shell, *room.boxes)
        self._build_atlas(bake(room, light))
        columns = (np.arange(geometry.width * _SAMPLES) + 0.5) / _SAMPLES - 0.5
        rows = (np.arange(geometry.height * _SAMPLES) + 0.5) / _SAMPLES - 0.5
        self._azimuth = geometry.azimuth_of_column(columns)
        elevation = geometry.elevation_of_row(rows)
        # A slope of exactly zero would divide by zero.
        self._slope = np.where(np.abs(elevation) < 1e-9, 1e-9, np.tan(elevation))[:, None]
        self._footprint = 2.0 * np.pi / (geometry.width * _SAMPLES) / np.cos(elevation)[:, None]

    def radiance(self, pose: ArrayLike) -> FloatImage:
        """What reaches the sensor, without noise.

        Parameters
        ----------
        pose : array_like of float, shape (3,)
            ``(x, y, theta)``, outside of furniture.

        Returns
        -------
        ndarray of float32, shape (height, width)
            1 = full scale; may exceed it.
        """
        x, y, theta = (float(value) for value in np.asarray(pose, dtype=np.float64))
        direction = np.stack([np.cos(self._azimuth + theta), np.sin(self._azimuth + theta)])
        direction = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
        distance, surface = self._hit_shell(np.array([x, y]), direction)
        for index, box in enumerate(self.room.boxes, start=1):
            self._hit_box(box, 6 * index, np.array([x, y]), direction, distance, surface)
        samples = self._look_up(np.array([x, y]), direction, distance, surface)
        size = (self.geometry.width, self.geometry.height)
        mean: FloatImage = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)
        return mean

    def render(self, pose: ArrayLike, rng: np.random.Generator) -> NDArray[np.uint8]:
        """An 8-bit picture with shot and read noise, gamma applied; shape (height, width). ``pose`` as in :meth:`radiance`."""
        electrons = self.radiance(pose) * _FULL_WELL
        noise = rng.standard_normal(electrons.shape, dtype=np.float32)
        noisy = electrons + noise * np.sqrt(electrons + _READ_NOISE**2)
        level = np.clip(noisy / _FULL_WELL, 0.0, 1.0) ** (1.0 / _GAMMA)
        return np.asarray(np.rint(255.0 * level), dtype=np.uint8)

    def _build_atlas(self, baked: list[list[FloatImage]]) -> None:
        """Put all surfaces in all sizes into one flat array, so that a pixel is one look-up."""
        pieces: list[FloatImage] = []
        count = len(self._boxes) * 6
        self._start = np.zeros((count, _LEVELS), dtype=np.intp)
        self._shape = np.zeros((count, _LEVELS, 2), dtype=np.intp)
        self._origin = np.zeros((count, 2))
        self._extent = np.zeros((count, 2))
        at = 0
        for index, (box, faces) in enumerate(zip(self._boxes, baked, strict=True)):
            for face, image in enumerate(faces):
                surface = 6 * index + face
                self._origin[surface] = box.low[1 if face < 2 else 0], box.low[1 if face >= 4 else 2]
                self._extent[surface] = face_size(box.low, box.high, face)
                for level in range(_LEVELS):
                    shape = (-(-image.shape[0] // 2**level), -(-image.shape[1] // 2**level))
                    piece = cv2.resize(image, shape[::-1], interpolation=cv2.INTER_AREA) if level else image
                    self._start[surface, level], self._shape[surface, level] = at, shape
                    pieces.append(piece.ravel())
                    at += piece.size
        self._atlas: FloatImage = np.concatenate(pieces)
        self._texel = self._extent[0, 0] / self._shape[0, 0, 1]

    def _hit_shell(self, at: FloatArray, direction: FloatArray) -> tuple[FloatArray, IntArray]:
        """Horizontal distance (rows, columns) to walls, floor and ceiling, and the number of the surface hit."""
        shell = self.room.shell
        ahead = direction > 0.0
        reach = (np.where(ahead, shell.high[:2, None], shell.low[:2, None]) - at[:, None]) / direction
        side = (reach[1] < reach[0]).astype(np.intp)
        wall = np.minimum(reach[0], reach[1])
        face = 2 * side + np.where(side == 1, ahead[1], ahead[0])
        plane = np.where(self._slope < 0.0, shell.low[2], shell.high[2])
        level = (plane - self.height_m) / self._slope
        distance = np.minimum(wall[None, :], level)
        surface = np.where(level < wall[None, :], np.where(self._slope < 0.0, 4, 5), face[None, :])
        return distance, surface.astype(np.intp)

    def _hit_box(
        self, box: Box, first: int, at: FloatArray, direction: FloatArray, distance: FloatArray, surface: IntArray
    ) -> None:
        """Enter a box into ``distance`` and ``surface`` where it is nearest."""
        one, two = ((corner[:2, None] - at[:, None]) / direction for corner in (box.low, box.high))
        near, far = np.minimum(one, two), np.maximum(one, two)
        enter, leave = near.max(axis=0), far.min(axis=0)
        columns = np.flatnonzero((enter < leave) & (enter > 0.0))
        if not len(columns):
            return
        enter, leave = enter[columns], leave[columns]
        side = (near[1] > near[0]).astype(np.intp)[columns]
        # The near x face is -x when the ray runs towards +x.
        face = 2 * side + (direction[side, columns] < 0.0)
        height = self.height_m + self._slope * enter
        # A ray that passes above (below) the near side may come down (up) onto the box farther on.
        level_z = np.where(height > box.high[2], box.high[2], box.low[2])
        level = (level_z - self.height_m) / self._slope
        on_side = (height >= box.low[2]) & (height <= box.high[2])
        reach = np.where(on_side, enter, np.where((level > enter) & (level < leave), level, np.inf))
        hit = np.where(on_side, face, np.where(height > box.high[2], 5, 4)) + first
        old = distance[:, columns]
        nearer = reach < old
        distance[:, columns] = np.where(nearer, reach, old)
        surface[:, columns] = np.where(nearer, hit, surface[:, columns])

    def _look_up(self, at: FloatArray, direction: FloatArray, distance: FloatArray, surface: IntArray) -> FloatImage:
        x, y = (at[axis] + distance * direction[axis] for axis in (0, 1))
        face = surface % 6
        u = np.where(face < 2, y, x)
        v = np.where(face >= 4, y, self.height_m + distance * self._slope)
        coarse = np.log2(np.maximum(distance * (self._footprint / self._texel), 1.0)).astype(np.intp)
        level = surface * _LEVELS + np.minimum(coarse, _LEVELS - 1)
        shape = self._shape.reshape(-1, 2)
        rows, columns = shape[:, 0][level], shape[:, 1][level]
        u = (u - self._origin[:, 0][surface]) / self._extent[:, 0][surface]
        v = (v - self._origin[:, 1][surface]) / self._extent[:, 1][surface]
        column = np.clip((u * columns).astype(np.intp), 0, columns - 1)
        row = np.clip((v * rows).astype(np.intp), 0, rows - 1)
        found: FloatImage = self._atlas[self._start.ravel()[level] + row * columns + column]
        return found

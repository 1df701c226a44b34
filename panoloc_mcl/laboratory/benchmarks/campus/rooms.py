"""Rooms for maps of a hundred thousand places: cast ray by ray, so that a panorama takes milliseconds.

All rooms have one size, one floor (boards with joints every half metre), one skirting, doors and windows of one make, and shelves and
pictures of like sizes. What is theirs is where these hang, how many there are, and what is on the pictures: as in an office building.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import PanoramaGeometry

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Inside of a room, and how far rooms are apart, metres.
SIZE_M, PITCH_M = (9.4, 7.4), (13.0, 11.0)
HEIGHT_M = 0.6
#: Walls end here; above, there is only their colour.
_WALL_M = 3.0
_TEXELS_A_METRE = 40
_FINER = 2
_GREY, _NOISE = 150.0, 6.0


@dataclass(frozen=True, eq=False)
class Room:
    """One room.

    Parameters
    ----------
    number : int
        What it is drawn from.
    corner : float64 (2,)
        Its lowest x and y, metres, map frame.
    """

    number: int
    corner: Float64

    @cached_property
    def _walls(self) -> tuple[Float32, ...]:
        """Of low and high x, low and high y: grey levels, (height, width), from the floor upwards."""
        rng = np.random.default_rng([7, self.number])
        return tuple(_wall(rng, SIZE_M[1] if side < 2 else SIZE_M[0]) for side in range(4))

    def panorama(self, geometry: PanoramaGeometry, pose: Float64, light: float = 1.0) -> NDArray[np.uint8]:
        """What a camera sees at a pose (3,) in the room, uint8 (rows, columns); ``light`` is a gain."""
        rows, columns = geometry.shape
        fine = np.arange(_FINER)[:, None]
        column = (np.arange(columns) + (fine + 0.5) / _FINER - 0.5).T.ravel()
        row = (np.arange(rows) + (fine + 0.5) / _FINER - 0.5).T.ravel()
        azimuth, slope = geometry.azimuth_of_column(column) + pose[2], np.tan(geometry.elevation_of_row(row))[:, None]
        x, y = pose[:2] - self.corner
        across = [np.where(np.abs(part) < 1e-9, 1e-9, part) for part in (np.cos(azimuth), np.sin(azimuth))]
        to_x = np.where(across[0] > 0.0, SIZE_M[0] - x, -x) / across[0]
        to_y = np.where(across[1] > 0.0, SIZE_M[1] - y, -y) / across[1]
        side = np.where(to_x < to_y, np.where(across[0] > 0.0, 1, 0), np.where(across[1] > 0.0, 3, 2))
        wall = np.minimum(to_x, to_y)
        along = np.where(side < 2, y + wall * across[1], x + wall * across[0])
        height = HEIGHT_M + wall * slope
        seen = np.empty(height.shape, dtype=np.float32)
        for index, texture in enumerate(self._walls):
            here = side == index
            seen[:, here] = _looked_up(texture, np.broadcast_to(along[here], height[:, here].shape), height[:, here])
        reach = HEIGHT_M / np.maximum(-slope, 1e-3)
        floor = _looked_up(_FLOOR, x + reach * across[0], y + reach * across[1])
        seen = np.where(height < 0.0, floor, seen)
        mean = seen.reshape(rows, _FINER, columns, _FINER).mean(axis=(1, 3))
        return np.asarray(np.clip(np.rint(light * mean), 0, 255), dtype=np.uint8)


def rooms(count: int) -> list[Room]:
    """So many rooms in rows, about as many as columns."""
    across = int(np.ceil(np.sqrt(count)))
    return [Room(index, np.array(PITCH_M) * (index % across, index // across)) for index in range(count)]


def _wall(rng: np.random.Generator, width_m: float) -> Float32:
    """A wall with a door or a window, shelves and pictures; later ones hide earlier ones."""
    shape = round(_WALL_M * _TEXELS_A_METRE), round(width_m * _TEXELS_A_METRE)
    wall = np.full(shape, _GREY, dtype=np.float32)
    _box(wall, 0.0, 0.0, width_m, 0.1, 60.0)
    at = rng.uniform(0.5, width_m - 1.5)
    if rng.random() < 0.5:
        _box(wall, at, 0.0, 0.9, 2.1, 90.0)
        _box(wall, at + 0.75, 1.0, 0.1, 0.1, 220.0)
    else:
        _box(wall, at, 0.9, 1.2, 1.3, 235.0)
        _box(wall, at + 0.57, 0.9, 0.06, 1.3, 120.0)
    for _ in range(rng.integers(3, 7)):
        # Shelves stand on the floor, with boards at heights of their own.
        left, wide, high = rng.uniform(0.0, width_m - 1.0), rng.uniform(0.4, 1.2), rng.uniform(0.6, 2.0)
        _box(wall, left, 0.0, wide, high, rng.uniform(40.0, 130.0))
        for board in np.arange(rng.uniform(0.2, 0.4), high, rng.uniform(0.25, 0.45)):
            _box(wall, left, board, wide, 0.04, rng.uniform(150.0, 230.0))
    for _ in range(rng.integers(3, 8)):
        left, up = rng.uniform(0.0, width_m - 0.8), rng.uniform(0.7, 2.0)
        wide, high = rng.uniform(0.2, 0.8, 2)
        _box(wall, left, up, wide, high, rng.uniform(30.0, 230.0))
        for _ in range(rng.integers(1, 5)):
            x, y = left + rng.uniform(0.0, 0.8 * wide), up + rng.uniform(0.0, 0.8 * high)
            _box(wall, x, y, 0.4 * wide * rng.random(), 0.4 * high * rng.random(), rng.uniform(20.0, 240.0))
    return _rough(wall, rng)


def _floor() -> Float32:
    """Boards half a metre wide, joints between them, and the grain that all floors share."""
    rng = np.random.default_rng(11)
    floor = np.full((round(SIZE_M[1] * _TEXELS_A_METRE), round(SIZE_M[0] * _TEXELS_A_METRE)), 110.0, dtype=np.float32)
    for index, up in enumerate(np.arange(0.0, SIZE_M[1], 0.5)):
        _box(floor, 0.0, up, SIZE_M[0], 0.5, 100.0 + 25.0 * rng.random())
        _box(floor, 0.0, up, SIZE_M[0], 0.03, 60.0)
        for left in np.arange(0.5 * (index % 3), SIZE_M[0], 1.5):
            _box(floor, left, up, 0.03, 0.5, 60.0)
    return _rough(floor, rng)


def _rough(surface: Float32, rng: np.random.Generator) -> Float32:
    noise = cv2.GaussianBlur(rng.standard_normal(surface.shape).astype(np.float32), (0, 0), 2.0)
    rough = cv2.GaussianBlur(surface, (0, 0), 0.7) + np.float32(_NOISE / noise.std()) * noise
    return np.asarray(rough, dtype=np.float32)


def _box(surface: Float32, left: float, up: float, wide: float, high: float, grey: float) -> None:
    rows, columns = (np.rint(np.array(ends) * _TEXELS_A_METRE).astype(int) for ends in ((up, up + high), (left, left + wide)))
    surface[rows[0] : rows[1], columns[0] : columns[1]] = grey


def _looked_up(surface: Float32, x: Float64, y: Float64) -> Float32:
    map_x, map_y = ((part * _TEXELS_A_METRE - 0.5).astype(np.float32) for part in (x, y))
    found = cv2.remap(surface, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, dtype=np.float32).reshape(np.shape(x))


_FLOOR = _floor()

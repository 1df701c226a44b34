"""Light in the room: windows, sun and lamps, with shadows, baked into the brightness of every surface."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from oracles.furnished_room.scene import Box, Pane, Room, face_size
from oracles.furnished_room.textures import TEXELS_PER_M

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]

_LIGHT_CELL_M = 0.08  # light varies more slowly than the pictures on the surfaces
_LIFT_M = 1e-3  # rays start this far above a surface, so that it does not shade itself


@dataclass(frozen=True)
class Light:
    """What shines at a time of day; radiances relative to a full-scale white surface.

    Parameters
    ----------
    south, west : float
        Radiance of the windows in the south and in the west wall.
    sun : float
        Irradiance of direct sun on a surface that faces it.
    sun_from : (float, float)
        Azimuth (map frame) and elevation of the sun, degrees.
    lamps : float
        Radiance of the lamps.
    """

    south: float
    west: float
    sun: float
    sun_from: tuple[float, float]
    lamps: float


LIGHTS = {
    "noon": Light(south=2.4, west=1.4, sun=1.1, sun_from=(-75.0, 48.0), lamps=0.0),
    "afternoon": Light(south=1.0, west=1.9, sun=0.9, sun_from=(172.0, 24.0), lamps=0.0),
    "evening": Light(south=0.05, west=0.1, sun=0.0, sun_from=(180.0, 1.0), lamps=11.0),
}


@dataclass(frozen=True, eq=False)
class _Source:
    """A small flat or round piece of something that shines."""

    position: FloatArray
    normal: FloatArray | None  # None: shines to all sides
    area: float
    kind: str  # south, west or lamps
    box: Box | None = None


def bake(room: Room, light: Light) -> list[list[FloatImage]]:
    """Brightness of every surface.

    Parameters
    ----------
    room : Room
    light : Light

    Returns
    -------
    list of list of ndarray of float32
        For the shell and then every box: six faces, laid out like their textures; radiance, 1 = full scale.
    """
    sources = [source for source in _sources(room) if getattr(light, source.kind) > 0.0]
    baked, weight, total = [], 0.0, 0.0
    for box in (room.shell, *room.boxes):
        irradiance = [_irradiance(room, box, face, light, sources) for face in range(6)]
        baked.append(irradiance)
        for face in range(6):
            width, height = face_size(box.low, box.high, face)
            weight += width * height
            total += width * height * float(irradiance[face].mean() * box.faces[face].mean())
    # Light that has been reflected often is about the same everywhere: the geometric series of the mean reflection.
    ambient = total / weight * 1.2
    result = []
    for box, irradiance in zip((room.shell, *room.boxes), baked, strict=True):
        result.append([_radiance(box, face, irradiance[face], ambient, light) for face in range(6)])
    for pane in room.panes:
        _glaze(result[0][pane.face], pane, light.south if pane.face == 2 else light.west)
    return result


def _radiance(box: Box, face: int, irradiance: FloatImage, ambient: float, light: Light) -> FloatImage:
    texture = box.faces[face]
    size = (texture.shape[1], texture.shape[0])
    smooth = cv2.resize(irradiance, size, interpolation=cv2.INTER_LINEAR)
    shining = light.lamps * 0.4 if box.lamp else 0.0
    return np.asarray(texture * (smooth + ambient) + shining, dtype=np.float32)


def _glaze(wall: FloatImage, pane: Pane, radiance: float) -> None:
    """The view through a window: sky above a dark skyline, and a crossbar."""
    row, column = round(pane.bottom_m * TEXELS_PER_M), round(pane.left_m * TEXELS_PER_M)
    height, width = round(pane.height_m * TEXELS_PER_M), round(pane.width_m * TEXELS_PER_M)
    glass = wall[row : row + height, column : column + width]
    rows = np.arange(height)[:, None] / height
    skyline = 0.22 + 0.10 * np.sin(np.arange(width) * 0.17 + 3.0 * pane.face) + 0.06 * np.sign(np.sin(np.arange(width) * 0.41))
    view = np.where(rows < skyline[None, :], 0.25, 0.75 + 0.25 * rows).astype(np.float32) * np.float32(radiance)
    bar = wall[row - 2, column - 2]  # as bright as the frame
    view[height // 2 - 1 : height // 2 + 2] = bar
    view[:, width // 2 - 1 : width // 2 + 2] = bar
    glass[...] = view


def _sources(room: Room) -> list[_Source]:
    sources = []
    for pane in room.panes:
        normal = np.array([0.0, 1.0, 0.0]) if pane.face == 2 else np.array([1.0, 0.0, 0.0])
        for i in (0.25, 0.75):
            for j in (0.25, 0.75):
                along, up = pane.left_m + i * pane.width_m, pane.bottom_m + j * pane.height_m
                offset = np.array([along, 0.0, up]) if pane.face == 2 else np.array([0.0, along, up])
                area = 0.25 * pane.width_m * pane.height_m
                sources.append(_Source(room.shell.low + offset, normal, area, "south" if pane.face == 2 else "west"))
    for box in room.boxes:
        if box.lamp:
            size = box.high - box.low
            sources.append(_Source(0.5 * (box.low + box.high), None, float(size[0] * size[2]), "lamps", box))
    return sources


def _irradiance(room: Room, box: Box, face: int, light: Light, sources: list[_Source]) -> FloatImage:
    points, normal, shape = _cells(box, face, inward=box is room.shell)
    arriving = np.zeros(len(points))
    for source in sources:
        towards = source.position - points
        square = np.maximum(np.einsum("ij,ij->i", towards, towards), 0.01)
        distance = np.sqrt(square)
        facing = np.maximum(towards @ normal, 0.0) / distance
        leaving = 1.0 if source.normal is None else np.maximum(-(towards @ source.normal), 0.0) / distance
        strength = getattr(light, source.kind) * source.area * facing * leaving / square
        lit = np.flatnonzero(strength > 1e-5)
        if source.box is not box and len(lit):
            obstacles = [other for other in room.boxes if other is not source.box]
            arriving[lit] += strength[lit] * ~_blocked(points[lit], towards[lit], obstacles)
    arriving += _sunshine(room, points, normal, light)
    return arriving.reshape(shape).astype(np.float32)


def _sunshine(room: Room, points: FloatArray, normal: FloatArray, light: Light) -> FloatArray:
    azimuth, elevation = np.radians(light.sun_from)
    sun = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    facing = float(normal @ sun)
    lit = np.zeros(len(points))
    if light.sun <= 0.0 or facing <= 0.0:
        return lit
    for pane in room.panes:
        axis, along = (1, 0) if pane.face == 2 else (0, 1)
        if sun[axis] >= 0.0:
            continue
        reach = (room.shell.low[axis] - points[:, axis]) / sun[axis]
        hit = points + reach[:, None] * sun - room.shell.low
        through = (reach > 0.0) & (np.abs(hit[:, along] - pane.left_m - 0.5 * pane.width_m) < 0.5 * pane.width_m)
        through &= np.abs(hit[:, 2] - pane.bottom_m - 0.5 * pane.height_m) < 0.5 * pane.height_m
        index = np.flatnonzero(through)
        if len(index):
            ways = reach[index, None] * sun
            lit[index] = light.sun * facing * ~_blocked(points[index], ways, list(room.boxes))
    return lit


def _cells(box: Box, face: int, inward: bool) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Centres of a face's light cells, its normal on the side that is seen, and the number of rows and columns."""
    axis, high_side = divmod(face, 2)
    width, height = face_size(box.low, box.high, face)
    shape = (max(2, round(height / _LIGHT_CELL_M)), max(2, round(width / _LIGHT_CELL_M)))
    rows, columns = np.meshgrid(*((np.arange(n) + 0.5) / n for n in shape), indexing="ij")
    along_columns, along_rows = (1, 2) if axis == 0 else (0, 2) if axis == 1 else (0, 1)
    normal = np.zeros(3)
    normal[axis] = (1.0 if high_side else -1.0) * (-1.0 if inward else 1.0)
    points = np.empty((shape[0] * shape[1], 3))
    points[:, axis] = (box.high if high_side else box.low)[axis] + _LIFT_M * normal[axis]
    points[:, along_columns] = box.low[along_columns] + columns.ravel() * width
    points[:, along_rows] = box.low[along_rows] + rows.ravel() * height
    return points, normal, shape


def _blocked(start: FloatArray, way: FloatArray, boxes: list[Box]) -> NDArray[np.bool_]:
    """Whether a box lies between each start and start + way; shapes (n, 3)."""
    inverse = 1.0 / np.where(np.abs(way) < 1e-9, 1e-9, way)
    blocked = np.zeros(len(start), dtype=bool)
    for box in boxes:
        first, second = (box.low - start) * inverse, (box.high - start) * inverse
        enter = np.minimum(first, second).max(axis=1)
        leave = np.maximum(first, second).min(axis=1)
        blocked |= (enter < leave) & (leave > 1e-6) & (enter < 1.0 - 1e-6)
    return blocked

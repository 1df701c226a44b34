"""The furnished room: boxes, the pictures on their faces, and what shines in them.

Faces are numbered -x, +x, -y, +y, -z, +z. A texture's columns run along y on x faces and along x on the others; its rows run
along y on z faces and along z on the others; both start at the box's low corner.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from oracles.furnished_room import textures as tx

FloatArray = NDArray[np.float64]

Corner = tuple[float, float, float]
Pictures = dict[str, tx.Texture]

ROBOT_HEIGHT_M = 0.9  # furniture that starts higher does not stand in the robot's way
LOW, HIGH = (-1.0, -1.0, 0.0), (5.0, 4.0, 2.7)  # the walls, map frame


@dataclass(frozen=True, eq=False)
class Box:
    """An axis-aligned box with a texture on each face.

    Parameters
    ----------
    low, high : ndarray of float64, shape (3,)
        Corners, metres.
    faces : tuple of six Texture
        Albedo, in the order -x, +x, -y, +y, -z, +z.
    lamp : bool
        Whether the box shines when the lamps are on.
    """

    low: FloatArray
    high: FloatArray
    faces: tuple[tx.Texture, ...]
    lamp: bool = False


@dataclass(frozen=True)
class Pane:
    """A window: a rectangle in the face of the room's shell that light comes through.

    Parameters
    ----------
    face : int
        0 (-x) or 2 (-y).
    left_m, bottom_m, width_m, height_m : float
        Measured from the face's low corner.
    """

    face: int
    left_m: float
    bottom_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True, eq=False)
class Room:
    """A room: its shell seen from inside, furniture, and windows.

    Parameters
    ----------
    shell : Box
        Walls, floor (face -z) and ceiling (face +z).
    boxes : tuple of Box
    panes : tuple of Pane
    """

    shell: Box
    boxes: tuple[Box, ...]
    panes: tuple[Pane, ...] = field(default=())

    def clearance(self, points: FloatArray) -> FloatArray:
        """Distance of points (..., 2) on the floor to the nearest furniture or wall, metres; 0 or less inside them."""
        p = np.asarray(points, dtype=np.float64)
        low, high = self.shell.low[:2], self.shell.high[:2]
        nearest = np.minimum((p - low).min(axis=-1), (high - p).min(axis=-1))
        for box in self.boxes:
            if box.low[2] < ROBOT_HEIGHT_M:
                gap = np.maximum(np.maximum(box.low[:2] - p, p - box.high[:2]), 0.0)
                nearest = np.minimum(nearest, np.hypot(gap[..., 0], gap[..., 1]))
        return np.asarray(nearest)


def face_size(low: FloatArray, high: FloatArray, face: int) -> tuple[float, float]:
    """Extent of a box's face along its texture's columns and rows, metres."""
    size = high - low
    return float(size[1 if face < 2 else 0]), float(size[1 if face >= 4 else 2])


def furnished_room(seed: int) -> Room:
    """The room with all its furniture; the seed decides pictures, stains and shades."""
    rng = np.random.default_rng([seed, 0])
    panes = (
        Pane(2, 0.6, 0.8, 1.3, 1.2),
        Pane(2, 2.5, 0.8, 1.3, 1.2),
        Pane(0, 3.3, 0.8, 1.2, 1.2),
    )
    return Room(_shell(rng, panes), _furniture(rng), panes)


def _shell(rng: np.random.Generator, panes: tuple[Pane, ...]) -> Box:
    low, high = np.array(LOW), np.array(HIGH)
    sizes = [face_size(low, high, face) for face in range(6)]
    west = tx.grained(rng, tx.blank(*sizes[0], 0.55), 0.12)
    east = tx.grained(rng, tx.blank(*sizes[1], 0.68), 0.10)
    south = tx.tiles(rng, *sizes[2], (0.30, 0.12), 0.42)
    north = tx.grained(rng, tx.blank(*sizes[3], 0.60), 0.10)
    north[: round(0.9 * tx.TEXELS_PER_M)] *= 0.55  # a painted dado
    floor = tx.tiles(rng, *sizes[4], (0.8, 0.2), 0.33)
    tx.paste(floor, tx.grained(rng, tx.checker(1.4, 1.0, 0.2, 0.15, 0.5), 0.2), 2.3, 0.5)  # rugs
    tx.paste(floor, tx.grained(rng, tx.stripes(0.9, 1.5, 0.3, 0.55, 0.2, False), 0.2), 1.6, 2.8)
    ceiling = tx.tiles(rng, *sizes[5], (0.6, 0.6), 0.75)
    for left, bottom, width, height in ((2.4, 0.9, 0.9, 0.7), (2.4, 1.9, 0.6, 0.9), (0.15, 0.9, 0.5, 0.7)):
        tx.paste(west, tx.poster(rng, width, height), left, bottom)
    tx.paste(west, tx.text_page(rng, 1.3, 0.8), 0.85, 1.0)
    for left, bottom, width, height in ((3.4, 1.0, 0.6, 0.8), (1.3, 1.25, 0.5, 0.5), (2.0, 1.2, 0.9, 0.6)):
        tx.paste(east, tx.poster(rng, width, height), left, bottom)
    tx.paste(east, tx.drawers(rng, 0.9, 2.05, (1, 1), 0.28), 0.25, 0.0)  # the door
    for left, bottom, width, height in ((2.75, 1.3, 0.7, 0.9), (4.6, 0.8, 0.8, 1.1), (0.6, 1.1, 0.5, 0.7)):
        tx.paste(north, tx.poster(rng, width, height), left, bottom)
    tx.paste(north, tx.stripes(0.5, 1.2, 0.16, 0.1, 0.8, True), 5.45, 0.6)
    tx.paste(south, tx.poster(rng, 0.8, 0.9), 4.0, 1.4)
    tx.paste(south, tx.checker(0.7, 0.9, 0.15, 0.08, 0.8), 5.2, 0.9)
    for wall in (west, east, north):
        wall[: round(0.08 * tx.TEXELS_PER_M)] = 0.15  # skirting board
    walls = (west, east, south, north, floor, ceiling)
    for pane in panes:
        frame = tx.blank(pane.width_m + 0.12, pane.height_m + 0.12, 0.85)
        tx.paste(walls[pane.face], frame, pane.left_m - 0.06, pane.bottom_m - 0.06)
    return Box(low, high, walls)


def _furniture(rng: np.random.Generator) -> tuple[Box, ...]:
    def box(low: Corner, high: Corner, albedo: float, pictures: Pictures | None = None, lamp: bool = False) -> Box:
        corners = np.array(low), np.array(high)
        faces = [tx.grained(rng, tx.blank(*face_size(*corners, face), albedo), 0.15) for face in range(6)]
        for face, name in enumerate(("west", "east", "south", "north", "below", "above")):
            faces[face] = (pictures or {}).get(name, faces[face])
        return Box(*corners, tuple(faces), lamp)

    crate = {name: tx.checker(0.28, 0.34, 0.09, 0.15, 0.6) for name in ("west", "east", "south", "north")}
    bands = {name: tx.stripes(0.3, 2.7, 0.5, 0.12, 0.7, False) for name in ("west", "east")}
    posts = {name: tx.poster(rng, 0.3, 2.7) for name in ("south", "north")}
    bricks = {name: tx.tiles(rng, 0.3, 2.7, (0.3, 0.12), 0.4) for name in ("east", "south")}
    sofa = tx.checker(1.6, 0.42, 0.14, 0.2, 0.35)
    return (
        box((0.2, 3.7, 0.0), (1.6, 4.0, 1.9), 0.45, {"south": tx.books(rng, 1.4, 1.9, 0.38)}),
        box((2.6, 3.6, 0.0), (3.4, 4.0, 1.1), 0.3, {"south": tx.drawers(rng, 0.8, 1.1, (2, 3), 0.5)}),
        box((4.55, 0.3, 0.68), (5.0, 1.7, 0.74), 0.5),  # a table: top and two sides
        box((4.55, 0.3, 0.0), (5.0, 0.36, 0.68), 0.4),
        box((4.55, 1.64, 0.0), (5.0, 1.7, 0.68), 0.4),
        box((4.8, 0.7, 0.74), (4.86, 1.25, 1.1), 0.06, {"west": tx.text_page(rng, 0.55, 0.36) * np.float32(0.5)}),
        box((4.6, 2.4, 0.0), (5.0, 3.3, 0.85), 0.6, {"west": tx.drawers(rng, 0.9, 0.85, (3, 2), 0.65)}),
        box((-1.0, 3.7, 0.0), (-0.7, 4.0, 2.7), 0.4, bricks),
        box((-1.0, 0.5, 0.0), (-0.5, 2.1, 0.42), 0.3, {"east": sofa}),
        box((-1.0, 0.5, 0.42), (-0.85, 2.1, 0.8), 0.25, {"east": sofa}),
        box((2.35, 1.35, 0.0), (2.65, 1.65, 2.7), 0.5, {**bands, **posts}),
        box((0.36, 2.36, 0.0), (0.64, 2.64, 0.34), 0.4, crate),
        box((0.6, -1.0, 0.0), (2.6, -0.8, 0.5), 0.7, {"north": tx.stripes(2.0, 0.5, 0.1, 0.3, 0.75, True)}),
        box((3.6, -1.0, 0.0), (4.3, -0.6, 1.25), 0.25, {"north": tx.drawers(rng, 0.7, 1.25, (1, 4), 0.35)}),
        box((0.4, 0.4, 1.7), (0.6, 0.6, 1.88), 0.8, lamp=True),
        box((3.4, 2.4, 1.7), (3.6, 2.6, 1.88), 0.8, lamp=True),
        box((-0.95, -0.95, 1.2), (-0.75, -0.75, 1.5), 0.8, lamp=True),
        box((-0.87, -0.87, 0.0), (-0.83, -0.83, 1.2), 0.1),  # the stand of the floor lamp
    )

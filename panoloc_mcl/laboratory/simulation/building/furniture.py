"""Things that stand in a place and can be moved: one function a kind, and the table of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.simulation.building.surfaces import CELL_M, COARSE_CELL_M, DARK, Surfaces
from panoloc_mcl.laboratory.simulation.scene import Box, Chair, Cylinder, Goal, Material, Place, Shelf, Stairs, Table

_SIDES = 12  # of a cylinder


def _box(surfaces: Surfaces, thing: Box, place: Place) -> None:
    surfaces.box(place, (0.0, 0.0, 0.0), thing.size_m, thing.material, COARSE_CELL_M if thing.coarse else CELL_M)
    surfaces.footprint(place, thing.size_m)


def _cylinder(surfaces: Surfaces, thing: Cylinder, place: Place) -> None:
    names = thing.rings or (thing.material,)
    rise = thing.height_m / len(names)
    angles = 2.0 * np.pi * (np.arange(_SIDES + 1) + 0.5) / _SIDES
    rim = np.column_stack([np.cos(angles), np.sin(angles)]) * thing.radius_m + np.array(place[:2])
    for ring, name in enumerate(names):
        z = place[2] + ring * rise
        for side in range(_SIDES):
            edge = rim[side + 1] - rim[side]
            size = float(np.hypot(*edge))
            surfaces.quad((*rim[side], z), (*edge, 0.0), (0.0, 0.0, rise), name, (size * side, 0.0), CELL_M)
    surfaces.parts.obstacle(rim[:-1], place[2], place[2] + thing.height_m)


def _table(surfaces: Surfaces, thing: Table, place: Place) -> None:
    wide, deep, high = thing.size_m
    surfaces.box(place, (0.0, 0.0, high - 0.03), (wide, deep, 0.03), thing.material)
    _legs(surfaces, place, wide / 2 - 0.04, deep / 2 - 0.04, 0.04, high - 0.03)
    surfaces.footprint(place, thing.size_m)


def _chair(surfaces: Surfaces, thing: Chair, place: Place) -> None:
    surfaces.box(place, (0.0, 0.0, 0.42), (0.42, 0.42, 0.05), thing.material)
    surfaces.box(place, (-0.2, 0.0, 0.55), (0.03, 0.4, 0.38), thing.material)
    _legs(surfaces, place, 0.18, 0.18, 0.03, 0.42)
    surfaces.footprint(place, (0.45, 0.45, 0.95))


def _legs(surfaces: Surfaces, place: Place, x: float, y: float, thick: float, high: float) -> None:
    for sx in (-x, x):
        for sy in (-y, y):
            surfaces.box(place, (sx, sy, 0.0), (thick, thick, high), DARK)


def _shelf(surfaces: Surfaces, thing: Shelf, place: Place) -> None:
    wide, deep, high = thing.size_m
    rise = high / thing.boards
    surfaces.box(place, (0.0, -deep / 2 + 0.01, 0.0), (wide, 0.02, high), thing.material)
    for side in (-1, 1):
        surfaces.box(place, (side * (wide / 2 - 0.01), 0.0, 0.0), (0.02, deep, high), thing.material)
    books = Material(albedo=0.35, pattern="books", contrast=1.0)
    for board in range(thing.boards):
        surfaces.box(place, (0.0, 0.0, board * rise), (wide, deep, 0.025), thing.material)
        surfaces.box(place, (0.0, -0.03, board * rise + 0.025), (wide - 0.04, deep * 0.7, rise * 0.85), books)
    surfaces.footprint(place, thing.size_m)


def _stairs(surfaces: Surfaces, thing: Stairs, place: Place) -> None:
    deep, wide, high = thing.step_m
    for step in range(thing.steps):
        surfaces.box(place, (step * deep, 0.0, step * high), (deep, wide, 0.06), thing.material)
    length, top = thing.steps * deep, thing.steps * high
    surfaces.footprint(place, (length, wide, top), (0.5 * (length - deep), 0.0))


def _goal(surfaces: Surfaces, thing: Goal, place: Place) -> None:
    deep, wide, high = thing.size_m
    for side in (-1, 1):
        surfaces.box(place, (-deep / 2, side * (wide / 2 - 0.03), 0.0), (deep, 0.06, high), thing.material)
    surfaces.box(place, (-deep + 0.02, 0.0, 0.0), (0.04, wide - 0.12, high), thing.inside)
    surfaces.box(place, (-deep / 2, 0.0, high), (deep, wide, 0.06), thing.material)
    surfaces.footprint(place, thing.size_m, (-deep / 2, 0.0))


#: Puts a thing of a kind in one place.
FURNITURE: dict[type, Callable[[Surfaces, Any, Place], None]] = {
    Box: _box,
    Cylinder: _cylinder,
    Table: _table,
    Chair: _chair,
    Shelf: _shelf,
    Stairs: _stairs,
    Goal: _goal,
}

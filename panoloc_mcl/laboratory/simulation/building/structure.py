"""What stands as it was built: walls with their openings, floors and ceilings, panes of glass and lamps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.simulation.building.surfaces import CELL_M, COARSE_CELL_M, DARK, Surfaces
from panoloc_mcl.laboratory.simulation.scene import Ground, Lamp, Material, Opening, Pane, Wall
from panoloc_mcl.laboratory.simulation.textures import field_texture
from panoloc_mcl.robot.errors import ConfigError

_FINE_CELL_M = 0.12
_COARSE_CELLS = 80  # at most, along a side of the ground outside


def _wall(surfaces: Surfaces, thing: Wall, index: int) -> None:
    start, end = np.array(thing.start), np.array(thing.end)
    length = float(np.hypot(*(end - start)))
    if length <= 0.0:
        raise ConfigError(f"objects.{index} (wall): starts where it ends; give it a length")
    turn = math.degrees(math.atan2(*(end - start)[::-1]))
    done = 0.0
    for opening in sorted(thing.openings, key=lambda one: one.at_m):
        right, top = opening.at_m + opening.width_m, opening.bottom_m + opening.height_m
        if opening.at_m < done - 1e-9 or right > length + 1e-9 or top > thing.height_m + 1e-9:
            raise ConfigError(
                f"objects.{index} (wall): opening at_m = {opening.at_m:g} does not fit a wall of {length:g} m x "
                f"{thing.height_m:g} m, or overlaps another; mend at_m, width_m or height_m"
            )
        _wall_piece(surfaces, thing, (done, opening.at_m, 0.0, thing.height_m), turn)
        _wall_piece(surfaces, thing, (opening.at_m, right, 0.0, opening.bottom_m), turn)
        _wall_piece(surfaces, thing, (opening.at_m, right, top, thing.height_m), turn)
        _bars(surfaces, thing, opening, turn)
        done = right
    _wall_piece(surfaces, thing, (done, length, 0.0, thing.height_m), turn)


def _along(thing: Wall, turn: float, metres: float, z: float) -> tuple[float, float, float, float]:
    """The place so far along a wall."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return thing.start[0] + c * metres, thing.start[1] + s * metres, z, turn


def _wall_piece(surfaces: Surfaces, thing: Wall, piece: tuple[float, float, float, float], turn: float) -> None:
    left, right, low, high = piece
    if right - left < 1e-6 or high - low < 1e-6:
        return
    surfaces.seed += 20
    place = _along(thing, turn, 0.5 * (left + right), low)
    size = (right - left, thing.thickness_m, high - low)
    surfaces.box(place, (0.0, 0.0, 0.0), size, thing.material, COARSE_CELL_M if thing.coarse else CELL_M, (left, low))
    if low < 2.0:
        surfaces.footprint(place, size)


def _bars(surfaces: Surfaces, thing: Wall, opening: Opening, turn: float) -> None:
    for bar in range(opening.bars):
        place = _along(thing, turn, opening.at_m + opening.width_m * (bar + 1) / (opening.bars + 1), opening.bottom_m)
        surfaces.box(place, (0.0, 0.0, 0.0), (0.06, 0.06, opening.height_m), DARK)
    if opening.bars:
        middle, high = opening.at_m + 0.5 * opening.width_m, opening.bottom_m + 0.55 * opening.height_m
        surfaces.box(_along(thing, turn, middle, high), (0.0, 0.0, 0.0), (opening.width_m, 0.05, 0.05), DARK)


def _ground(surfaces: Surfaces, thing: Ground, index: int) -> None:
    x0, y0, x1, y1 = thing.area
    wide, high = x1 - x0, y1 - y0
    material = surfaces.materials[thing.material]
    up = thing.kind == "floor"
    along, across = ((wide, 0.0, 0.0), (0.0, high, 0.0)) if up else ((0.0, high, 0.0), (wide, 0.0, 0.0))
    coarse = max(COARSE_CELL_M, max(wide, high) / _COARSE_CELLS)
    cell = coarse if thing.coarse else _FINE_CELL_M if up else CELL_M
    if thing.field is not None:
        left, low, right, top = thing.field
        texture = field_texture(material, wide, high, (left - x0, low - y0, right - x0, top - y0))
        surfaces.parts.add((x0, y0, thing.z), along, across, texture, cell)
    else:
        surfaces.quad((x0, y0, thing.z), along, across, thing.material, (x0, y0), cell)


def _pane(surfaces: Surfaces, thing: Pane, index: int) -> None:
    source = surfaces.parts.light_source(f"pane {index}", "pane", thing.transmittance)
    # Seen from below.
    corner, along, across = (np.array(value) for value in (thing.corner, thing.along, thing.across))
    if np.cross(along, across)[2] > 0.0:
        along, across = across, along
    surfaces.parts.add(corner, along, across, np.full((1, 1), 0.3, np.float32), 0.5, source)


def _lamp(surfaces: Surfaces, thing: Lamp, index: int) -> None:
    wide, deep = thing.size_m
    source = surfaces.parts.light_source("lamps", "lamp", thing.lumen / (math.pi * wide * deep))
    for place in thing.places:
        turn = math.radians(place[3])
        a = np.array([math.cos(turn), math.sin(turn), 0.0]) * wide
        b = np.array([-math.sin(turn), math.cos(turn), 0.0]) * deep
        corner = np.array(place[:3]) - 0.5 * (a + b)
        surfaces.parts.add(corner, b, a, np.full((1, 1), 0.5, np.float32), 0.6, source)
        white = Material(albedo=0.6)
        surfaces.box((place[0], place[1], place[2] + 0.005, place[3]), (0.0, 0.0, 0.0), (wide, deep, 0.08), white)


#: Puts up a thing of a kind; ``index`` is its number in the scene, for its name and for faults.
STRUCTURE: dict[type, Callable[[Surfaces, Any, int], None]] = {Wall: _wall, Ground: _ground, Pane: _pane, Lamp: _lamp}

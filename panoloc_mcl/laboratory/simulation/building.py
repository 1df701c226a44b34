"""From a scene's description to its surfaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.patches import Patches, PatchList, assemble
from panoloc_mcl.laboratory.simulation.scene import (
    Box,
    Chair,
    Clutter,
    Cylinder,
    Goal,
    Ground,
    Lamp,
    Material,
    Mesh,
    Pane,
    Place,
    Scene,
    Shelf,
    Stairs,
    Table,
    Wall,
)
from panoloc_mcl.laboratory.simulation.textures import field_texture, texture_of
from panoloc_mcl.robot.errors import ConfigError

FloatArray = NDArray[np.float64]

_CELL_M = 0.25
_FINE_CELL_M = 0.12
_COARSE_CELL_M = 1.5
_COARSE_CELLS = 80  # at most, along a side of the ground outside
_DARK = Material(albedo=0.06)
_SIDES = 12  # of a cylinder


@dataclass(frozen=True, eq=False)
class Building:
    """A scene as it stands.

    Parameters
    ----------
    scene : Scene
    patches : Patches
    footprints : tuple of ndarray of float64, shape (n, 2)
        Outlines of all things from above.
    heights : tuple of (float, float)
        Between which heights each stands.
    """

    scene: Scene
    patches: Patches
    footprints: tuple[FloatArray, ...]
    heights: tuple[tuple[float, float], ...]


def build(scene: Scene, folder: Path = Path(), moved: float = 0.0, seed: int = 0) -> Building:
    """Put up a scene.

    Parameters
    ----------
    scene : Scene
    folder : Path
        Where relative paths of meshes start.
    moved : float
        Share of the movable things that have been moved, up to half a metre, and turned.
    seed : int
        Which ones, and whereto.

    Raises
    ------
    ConfigError
        A mesh that is missing or cannot be read, or openings that do not fit their wall.
    """
    builder = _Builder(scene, folder, moved, np.random.default_rng([seed, 5]))
    for index, thing in enumerate(scene.objects):
        builder.add(index, thing)
    parts = builder.parts
    return Building(scene, assemble(parts), tuple(parts.footprints), tuple(parts.heights))


class _Builder:
    def __init__(self, scene: Scene, folder: Path, moved: float, rng: np.random.Generator) -> None:
        self.scene, self.folder, self.moved, self.rng = scene, folder, moved, rng
        self.parts = PatchList()
        self.seed = 0

    def add(self, index: int, thing: Any) -> None:
        self.seed = 1000 * index
        if isinstance(thing, Wall):
            self._wall(index, thing)
        elif isinstance(thing, Ground):
            self._ground(thing)
        elif isinstance(thing, Clutter):
            self._clutter(thing)
        elif isinstance(thing, Pane):
            source = self.parts.light_source(f"pane {index}", "pane", thing.transmittance)
            # Seen from below.
            corner, along, across = (np.array(value) for value in (thing.corner, thing.along, thing.across))
            if np.cross(along, across)[2] > 0.0:
                along, across = across, along
            self.parts.add(corner, along, across, np.full((1, 1), 0.3, np.float32), 0.5, source)
        elif isinstance(thing, Lamp):
            self._lamp(thing)
        elif isinstance(thing, Mesh):
            self._mesh(index, thing)
        else:
            for place in thing.places:
                self._standing(thing, self._shifted(place, thing.movable))

    def _shifted(self, place: Place, movable: bool) -> Place:
        if not movable:
            return place
        # Drawn for all alike, so that a larger share moves the same things and some more.
        draw, dx, dy, turn = self.rng.uniform(size=4)
        if draw >= self.moved:
            return place
        return place[0] + (dx - 0.5), place[1] + (dy - 0.5), place[2], place[3] + 120.0 * (turn - 0.5)

    def _standing(self, thing: Any, place: Place) -> None:
        self.seed += 20
        if isinstance(thing, Box):
            self._box(place, (0.0, 0.0, 0.0), thing.size_m, thing.material, _COARSE_CELL_M if thing.coarse else _CELL_M)
            self._footprint(place, thing.size_m)
        elif isinstance(thing, Cylinder):
            self._cylinder(thing, place)
        elif isinstance(thing, Table):
            wide, deep, high = thing.size_m
            self._box(place, (0.0, 0.0, high - 0.03), (wide, deep, 0.03), thing.material)
            for sx in (-1.0, 1.0):
                for sy in (-1.0, 1.0):
                    self._box(place, (sx * (wide / 2 - 0.04), sy * (deep / 2 - 0.04), 0.0), (0.04, 0.04, high - 0.03), _DARK)
            self._footprint(place, thing.size_m)
        elif isinstance(thing, Chair):
            self._box(place, (0.0, 0.0, 0.42), (0.42, 0.42, 0.05), thing.material)
            self._box(place, (-0.2, 0.0, 0.55), (0.03, 0.4, 0.38), thing.material)
            for sx in (-0.18, 0.18):
                for sy in (-0.18, 0.18):
                    self._box(place, (sx, sy, 0.0), (0.03, 0.03, 0.42), _DARK)
            self._footprint(place, (0.45, 0.45, 0.95))
        elif isinstance(thing, Shelf):
            self._shelf(thing, place)
        elif isinstance(thing, Stairs):
            deep, wide, high = thing.step_m
            for step in range(thing.steps):
                self._box(place, (step * deep, 0.0, step * high), (deep, wide, 0.06), thing.material)
            length, top = thing.steps * deep, thing.steps * high
            self._footprint(place, (length, wide, top), (0.5 * (length - deep), 0.0))
        elif isinstance(thing, Goal):
            deep, wide, high = thing.size_m
            for side in (-1, 1):
                self._box(place, (-deep / 2, side * (wide / 2 - 0.03), 0.0), (deep, 0.06, high), thing.material)
            self._box(place, (-deep + 0.02, 0.0, 0.0), (0.04, wide - 0.12, high), thing.inside)
            self._box(place, (-deep / 2, 0.0, high), (deep, wide, 0.06), thing.material)
            self._footprint(place, thing.size_m, (-deep / 2, 0.0))

    def _shelf(self, thing: Shelf, place: Place) -> None:
        wide, deep, high = thing.size_m
        rise = high / thing.boards
        self._box(place, (0.0, -deep / 2 + 0.01, 0.0), (wide, 0.02, high), thing.material)
        for side in (-1, 1):
            self._box(place, (side * (wide / 2 - 0.01), 0.0, 0.0), (0.02, deep, high), thing.material)
        books = Material(albedo=0.35, pattern="books", contrast=1.0)
        for board in range(thing.boards):
            self._box(place, (0.0, 0.0, board * rise), (wide, deep, 0.025), thing.material)
            self._box(place, (0.0, -0.03, board * rise + 0.025), (wide - 0.04, deep * 0.7, rise * 0.85), books)
        self._footprint(place, thing.size_m)

    def _cylinder(self, thing: Cylinder, place: Place) -> None:
        names = thing.rings or (thing.material,)
        rise = thing.height_m / len(names)
        angles = 2.0 * np.pi * (np.arange(_SIDES + 1) + 0.5) / _SIDES
        rim = np.column_stack([np.cos(angles), np.sin(angles)]) * thing.radius_m + np.array(place[:2])
        for ring, name in enumerate(names):
            z = place[2] + ring * rise
            for side in range(_SIDES):
                edge = rim[side + 1] - rim[side]
                size = float(np.hypot(*edge))
                self._quad((*rim[side], z), (*edge, 0.0), (0.0, 0.0, rise), name, (size * side, 0.0), _CELL_M)
        self.parts.obstacle(rim[:-1], place[2], place[2] + thing.height_m)

    def _clutter(self, thing: Clutter) -> None:
        rng = np.random.default_rng([thing.seed, 9])
        x0, y0, x1, y1 = thing.area
        for _ in range(thing.count):
            size = tuple(float(value) for value in rng.uniform(*thing.size_m, 3))
            at = (float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1)), thing.z, float(rng.uniform(0.0, 90.0)))
            name = thing.materials[int(rng.integers(len(thing.materials)))]
            self.seed += 20
            place = self._shifted(at, thing.movable)
            self._box(place, (0.0, 0.0, 0.0), (size[0], size[1], size[2]), name)
            self._footprint(place, (size[0], size[1], size[2]))

    def _ground(self, thing: Ground) -> None:
        x0, y0, x1, y1 = thing.area
        wide, high = x1 - x0, y1 - y0
        material = self.scene.materials[thing.material]
        up = thing.kind == "floor"
        along, across = ((wide, 0.0, 0.0), (0.0, high, 0.0)) if up else ((0.0, high, 0.0), (wide, 0.0, 0.0))
        coarse = max(_COARSE_CELL_M, max(wide, high) / _COARSE_CELLS)
        cell = coarse if thing.coarse else _FINE_CELL_M if up else _CELL_M
        if thing.field is not None:
            left, low, right, top = thing.field
            texture = field_texture(material, wide, high, (left - x0, low - y0, right - x0, top - y0))
            self.parts.add((x0, y0, thing.z), along, across, texture, cell)
        else:
            self._quad((x0, y0, thing.z), along, across, thing.material, (x0, y0), cell)

    def _lamp(self, thing: Lamp) -> None:
        wide, deep = thing.size_m
        source = self.parts.light_source("lamps", "lamp", thing.lumen / (math.pi * wide * deep))
        for place in thing.places:
            turn = math.radians(place[3])
            a = np.array([math.cos(turn), math.sin(turn), 0.0]) * wide
            b = np.array([-math.sin(turn), math.cos(turn), 0.0]) * deep
            corner = np.array(place[:3]) - 0.5 * (a + b)
            self.parts.add(corner, b, a, np.full((1, 1), 0.5, np.float32), 0.6, source)
            white = Material(albedo=0.6)
            self._box((place[0], place[1], place[2] + 0.005, place[3]), (0.0, 0.0, 0.0), (wide, deep, 0.08), white)

    def _wall(self, index: int, thing: Wall) -> None:
        start, end = np.array(thing.start), np.array(thing.end)
        length = float(np.hypot(*(end - start)))
        if length <= 0.0:
            raise ConfigError(f"objects.{index} (wall): starts where it ends; give it a length")
        turn = math.degrees(math.atan2(*(end - start)[::-1]))
        cell = _COARSE_CELL_M if thing.coarse else _CELL_M
        done = 0.0
        for opening in sorted(thing.openings, key=lambda one: one.at_m):
            right, top = opening.at_m + opening.width_m, opening.bottom_m + opening.height_m
            if opening.at_m < done - 1e-9 or right > length + 1e-9 or top > thing.height_m + 1e-9:
                raise ConfigError(
                    f"objects.{index} (wall): opening at_m = {opening.at_m:g} does not fit a wall of {length:g} m x "
                    f"{thing.height_m:g} m, or overlaps another; mend at_m, width_m or height_m"
                )
            pieces = [(done, opening.at_m, 0.0, thing.height_m), (opening.at_m, right, 0.0, opening.bottom_m)]
            pieces.append((opening.at_m, right, top, thing.height_m))
            for piece in pieces:
                self._wall_piece(thing, piece, turn, cell)
            self._bars(thing, opening, turn)
            done = right
        self._wall_piece(thing, (done, length, 0.0, thing.height_m), turn, cell)

    def _wall_piece(self, thing: Wall, piece: tuple[float, float, float, float], turn: float, cell: float) -> None:
        left, right, low, high = piece
        if right - left < 1e-6 or high - low < 1e-6:
            return
        self.seed += 20
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        middle = 0.5 * (left + right)
        place = (thing.start[0] + c * middle, thing.start[1] + s * middle, low, turn)
        size = (right - left, thing.thickness_m, high - low)
        self._box(place, (0.0, 0.0, 0.0), size, thing.material, cell, (left, low))
        if low < 2.0:
            self._footprint(place, size)

    def _bars(self, thing: Wall, opening: Any, turn: float) -> None:
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        for bar in range(opening.bars):
            at = opening.at_m + opening.width_m * (bar + 1) / (opening.bars + 1)
            place = (thing.start[0] + c * at, thing.start[1] + s * at, opening.bottom_m, turn)
            self._box(place, (0.0, 0.0, 0.0), (0.06, 0.06, opening.height_m), _DARK)
        if opening.bars:
            middle = opening.at_m + 0.5 * opening.width_m
            place = (thing.start[0] + c * middle, thing.start[1] + s * middle, opening.bottom_m + 0.55 * opening.height_m, turn)
            self._box(place, (0.0, 0.0, 0.0), (opening.width_m, 0.05, 0.05), _DARK)

    def _box(
        self,
        place: Place,
        offset: tuple[float, float, float],
        size: tuple[float, float, float],
        material: str | Material,
        cell: float = _CELL_M,
        at: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """A box whose underside's middle lies at an offset from a place, turned with it."""
        turn = math.radians(place[3])
        ex, ey, ez = (
            np.array([math.cos(turn), math.sin(turn), 0.0]),
            np.array([-math.sin(turn), math.cos(turn), 0.0]),
            np.eye(3)[2],
        )
        low = np.array(place[:3]) + (offset[0] - size[0] / 2) * ex + (offset[1] - size[1] / 2) * ey + offset[2] * ez
        a, b, c = ex * size[0], ey * size[1], ez * size[2]
        sides = (
            (low, a, c),
            (low + a + b, -a, c),
            (low + b, -b, c),
            (low + a, b, c),
            (low + c, a, b),
            (low, b, a),
        )
        for side in sides:
            self._quad(side[0], side[1], side[2], material, at, cell)

    def _quad(
        self, origin: Any, along: Any, across: Any, material: str | Material, at: tuple[float, float], cell: float
    ) -> None:
        self.seed += 1
        found = self.scene.materials[material] if isinstance(material, str) else material
        size = float(np.linalg.norm(along)), float(np.linalg.norm(across))
        # Edges of boards carry no picture.
        plain = min(size) < 0.04 or (found.pattern in ("poster", "text", "books") and min(size) < 0.12)
        texture = texture_of(found.model_copy(update={"pattern": "plain"}) if plain else found, *size, at, self.seed)
        self.parts.add(origin, along, across, texture, cell)

    def _footprint(self, place: Place, size: Sequence[float], offset: tuple[float, float] = (0.0, 0.0)) -> None:
        turn = math.radians(place[3])
        corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * np.array(size[:2]) + np.array(offset)
        c, s = math.cos(turn), math.sin(turn)
        outline = corners @ np.array([[c, s], [-s, c]]) + np.array(place[:2])
        self.parts.obstacle(outline, place[2], place[2] + size[2])

    def _mesh(self, index: int, thing: Mesh) -> None:
        path = thing.file if thing.file.is_absolute() else self.folder / thing.file
        vertices, faces, albedo = read_mesh(path, f"objects.{index}.file")
        if thing.y_up:
            vertices = vertices[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0])
        turn = math.radians(thing.place[3])
        c, s = math.cos(turn), math.sin(turn)
        placed = (vertices * thing.scale) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array(thing.place[:3])
        for face, shade in zip(faces, albedo, strict=True):
            a, b, c3 = placed[face]
            if np.linalg.norm(np.cross(b - a, c3 - a)) < 1e-10:
                continue
            texture = np.full((1, 1), shade if thing.albedo is None else thing.albedo, np.float32)
            self.parts.add(a, b - a, c3 - a, texture, _CELL_M, triangle=True)
            low, high = float(placed[face, 2].min()), float(placed[face, 2].max())
            if high > 0.05 and high - low > 0.02:
                self.parts.obstacle(placed[face, :2], low, high)


def read_mesh(path: Path, where: str) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    """Vertices (v, 3), triangles (f, 3) and their albedos (f,) of a mesh file; colours are taken as sRGB.

    Raises
    ------
    ConfigError
        No such file, trimesh is not installed, or nothing that it can read.
    """
    if not path.is_file():
        raise ConfigError(f"{where} = '{path}': no such file; check the path")
    try:
        import trimesh
    except ImportError as error:
        raise ConfigError(f"{where} = '{path}': meshes need trimesh; install the extra 'simulate'") from error
    try:
        mesh = trimesh.load(path, force="mesh")
        colours = np.asarray(mesh.visual.to_color().face_colors if mesh.visual.kind == "texture" else mesh.visual.face_colors)
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # its readers raise whatever comes
        raise ConfigError(f"{where} = '{path}': cannot be read as a mesh ({error}); write glTF, OBJ, PLY or STL") from error
    if len(faces) == 0:
        raise ConfigError(f"{where} = '{path}': holds no triangles; check the export")
    linear = (colours[:, :3].astype(np.float64) / 255.0) ** 2.2
    return vertices, faces, np.clip(linear @ np.array([0.2126, 0.7152, 0.0722]), 0.02, 0.9)

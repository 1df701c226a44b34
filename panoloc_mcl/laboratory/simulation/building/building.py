"""A scene as it stands: everything put up, with some of the movable things moved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.building.furniture import FURNITURE
from panoloc_mcl.laboratory.simulation.building.meshes import put_mesh
from panoloc_mcl.laboratory.simulation.building.structure import STRUCTURE
from panoloc_mcl.laboratory.simulation.building.surfaces import Surfaces
from panoloc_mcl.laboratory.simulation.patches import Patches, assemble
from panoloc_mcl.laboratory.simulation.scene import Box, Clutter, Mesh, Place, Scene, Thing

FloatArray = NDArray[np.float64]


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
    rng = np.random.default_rng([seed, 5])
    surfaces = Surfaces(scene.materials)
    for index, thing in enumerate(scene.objects):
        surfaces.seed = 1000 * index
        if isinstance(thing, Mesh):
            put_mesh(surfaces, thing, index, folder)
        elif isinstance(thing, Thing | Clutter):
            for piece, place in _pieces(thing):
                surfaces.seed += 20
                FURNITURE[type(piece)](surfaces, piece, _shifted(place, moved, rng) if thing.movable else place)
        else:
            STRUCTURE[type(thing)](surfaces, thing, index)
    parts = surfaces.parts
    return Building(scene, assemble(parts), tuple(parts.footprints), tuple(parts.heights))


def _shifted(place: Place, moved: float, rng: np.random.Generator) -> Place:
    """The place after somebody may have moved what stands there."""
    # Drawn for all alike, so that a larger share moves the same things and some more.
    draw, dx, dy, turn = rng.uniform(size=4)
    if draw >= moved:
        return place
    return place[0] + (dx - 0.5), place[1] + (dy - 0.5), place[2], place[3] + 120.0 * (turn - 0.5)


def _pieces(thing: Thing | Clutter) -> Iterator[tuple[Thing, Place]]:
    """What stands where."""
    if isinstance(thing, Thing):
        yield from ((thing, place) for place in thing.places)
        return
    rng = np.random.default_rng([thing.seed, 9])
    x0, y0, x1, y1 = thing.area
    for _ in range(thing.count):
        wide, deep, high = (float(value) for value in rng.uniform(*thing.size_m, 3))
        place = (float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1)), thing.z, float(rng.uniform(0.0, 90.0)))
        material = thing.materials[int(rng.integers(len(thing.materials)))]
        yield Box(kind="box", size_m=(wide, deep, high), material=material), place

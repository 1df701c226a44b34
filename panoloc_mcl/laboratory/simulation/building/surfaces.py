"""The surfaces of a scene as they are put up: boxes, rectangles with their pictures, and outlines of what stands in the way."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.simulation.patches import PatchList
from panoloc_mcl.laboratory.simulation.scene import Material, Place
from panoloc_mcl.laboratory.simulation.textures import texture_of

CELL_M = 0.25
COARSE_CELL_M = 1.5
DARK = Material(albedo=0.06)


class Surfaces:
    """Surfaces put up so far.

    Parameters
    ----------
    materials : mapping of str to Material
        Of the scene, by name.
    """

    def __init__(self, materials: Mapping[str, Material]) -> None:
        self.materials = materials
        self.parts = PatchList()
        # Of the next picture's pattern.
        self.seed = 0

    def box(
        self,
        place: Place,
        offset: tuple[float, float, float],
        size: tuple[float, float, float],
        material: str | Material,
        cell: float = CELL_M,
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
        for origin, along, across in sides:
            self.quad(origin, along, across, material, at, cell)

    def quad(
        self, origin: Any, along: Any, across: Any, material: str | Material, at: tuple[float, float], cell: float
    ) -> None:
        """A rectangle that carries its material's picture from the point ``at`` on, m."""
        self.seed += 1
        found = self.materials[material] if isinstance(material, str) else material
        size = float(np.linalg.norm(along)), float(np.linalg.norm(across))
        # Edges of boards carry no picture.
        plain = min(size) < 0.04 or (found.pattern in ("poster", "text", "books") and min(size) < 0.12)
        texture = texture_of(found.model_copy(update={"pattern": "plain"}) if plain else found, *size, at, self.seed)
        self.parts.add(origin, along, across, texture, cell)

    def footprint(self, place: Place, size: Sequence[float], offset: tuple[float, float] = (0.0, 0.0)) -> None:
        """The outline of a box as an obstacle."""
        turn = math.radians(place[3])
        corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * np.array(size[:2]) + np.array(offset)
        c, s = math.cos(turn), math.sin(turn)
        outline = corners @ np.array([[c, s], [-s, c]]) + np.array(place[:2])
        self.parts.obstacle(outline, place[2], place[2] + size[2])

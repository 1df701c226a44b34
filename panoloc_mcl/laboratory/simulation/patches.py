"""Surfaces: parallelograms (or halves of them, triangles) with an albedo texture, a light map and perhaps light of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.laboratory.simulation.textures import Texture

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_AROUND_CELLS = 2.0


@dataclass
class PatchList:
    """Collects surfaces, and what of them a robot would run into."""

    origins: list[FloatArray] = field(default_factory=list)
    along: list[FloatArray] = field(default_factory=list)
    across: list[FloatArray] = field(default_factory=list)
    triangle: list[bool] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    cell_m: list[float] = field(default_factory=list)
    source: list[int] = field(default_factory=list)
    source_names: list[str] = field(default_factory=list)
    source_kinds: list[str] = field(default_factory=list)
    source_strength: list[float] = field(default_factory=list)
    footprints: list[FloatArray] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)

    def add(
        self,
        origin: ArrayLike,
        along: ArrayLike,
        across: ArrayLike,
        texture: Texture,
        cell_m: float = 0.2,
        source: int = -1,
        triangle: bool = False,
    ) -> None:
        """Add a surface, seen from the side that ``along x across`` points to."""
        self.origins.append(np.asarray(origin, dtype=np.float64))
        self.along.append(np.asarray(along, dtype=np.float64))
        self.across.append(np.asarray(across, dtype=np.float64))
        self.textures.append(texture)
        self.cell_m.append(cell_m)
        self.source.append(source)
        self.triangle.append(triangle)

    def obstacle(self, outline: ArrayLike, low: float, high: float) -> None:
        """Remember a thing's outline from above, shape (n, 2), and between which heights it stands."""
        self.footprints.append(np.asarray(outline, dtype=np.float64))
        self.heights.append((low, high))

    def light_source(self, name: str, kind: str, strength: float) -> int:
        """Number of a light source: kind ``pane`` (strength: transmittance) or ``lamp`` (luminance, cd/m2)."""
        key = (name, kind, strength)
        for index, known in enumerate(zip(self.source_names, self.source_kinds, self.source_strength, strict=True)):
            if known == key:
                return index
        self.source_names.append(name)
        self.source_kinds.append(kind)
        self.source_strength.append(strength)
        return len(self.source_names) - 1


@dataclass(frozen=True, eq=False)
class Patches:
    """Surfaces in arrays, with all textures in one and room for all light maps in one.

    Parameters
    ----------
    origin, along, across, normal : ndarray of float64, shape (n, 3)
    triangle : ndarray of bool, shape (n,)
        Only the half at the origin is there.
    texels : ndarray of float32, shape (t,)
        Albedos, texture after texture, row after row.
    texture_at : ndarray of int64, shape (n, 3)
        Offset, rows and columns of every texture.
    cells_at : ndarray of int64, shape (n, 3)
        Offset, rows and columns of every light map.
    mean_albedo : ndarray of float64, shape (n,)
    source : ndarray of int64, shape (n,)
        Number of the light source that a surface belongs to; -1 for none.
    sources : tuple of (str, str, float)
        Name, kind and strength.
    """

    origin: FloatArray
    along: FloatArray
    across: FloatArray
    normal: FloatArray
    triangle: NDArray[np.bool_]
    texels: NDArray[np.float32]
    texture_at: IntArray
    cells_at: IntArray
    mean_albedo: FloatArray
    source: IntArray
    sources: tuple[tuple[str, str, float], ...]

    def __len__(self) -> int:
        return len(self.origin)

    @property
    def cells(self) -> int:
        """Cells of all light maps."""
        return int(self.cells_at[-1, 0] + self.cells_at[-1, 1] * self.cells_at[-1, 2])

    def triangles(self) -> tuple[NDArray[np.float32], NDArray[np.uint32], IntArray]:
        """Vertices (v, 3), faces (f, 3), and the surface of every face (f,)."""
        corners = np.stack(
            [self.origin, self.origin + self.along, self.origin + self.along + self.across, self.origin + self.across], axis=1
        )
        first = 4 * np.arange(len(self))
        lower = np.stack([first, first + 1, np.where(self.triangle, first + 3, first + 2)], axis=1)
        upper = np.stack([first, first + 2, first + 3], axis=1)[~self.triangle]
        owner = np.concatenate([np.arange(len(self)), np.flatnonzero(~self.triangle)])
        faces = np.concatenate([lower, upper])
        return corners.reshape(-1, 3).astype(np.float32), faces.astype(np.uint32), owner

    def cell_points(self, shift: FloatArray) -> tuple[FloatArray, IntArray]:
        """A point in every cell of every light map, and the surface it lies on.

        Parameters
        ----------
        shift : ndarray of float64, shape (cells, 2)
            Where in its cell, 0..1 across and along.
        """
        owner = np.repeat(np.arange(len(self)), self.cells_at[:, 1] * self.cells_at[:, 2])
        inside = np.arange(self.cells) - self.cells_at[owner, 0]
        rows, columns = self.cells_at[owner, 1], self.cells_at[owner, 2]
        t = (inside // columns + shift[:, 0]) / rows
        s = (inside % columns + shift[:, 1]) / columns
        # Points of the half that is not there are mirrored into the one that is.
        outside = self.triangle[owner] & (s + t > 1.0)
        s, t = np.where(outside, 1.0 - s, s), np.where(outside, 1.0 - t, t)
        return self.origin[owner] + s[:, None] * self.along[owner] + t[:, None] * self.across[owner], owner

    def smoothed(self, values: FloatArray) -> FloatArray:
        """Values of all cells (cells,), smoothed within each light map: for light that varies slowly, but is known roughly."""

        def smooth(picture: FloatArray) -> NDArray[Any]:
            single = picture.astype(np.float32)
            return _blurred(cv2.medianBlur(single, 3) if min(single.shape) >= 3 else single, 1.5)

        return self._map_by_map(smooth, values)

    def denoised(self, values: FloatArray, variance: FloatArray) -> FloatArray:
        """Values of all cells (cells,), each drawn towards the mean around it by as much as their differences are noise.

        Lee's filter (1980): what varies more than its noise explains, edges of shadows among it, stays as it is.

        Parameters
        ----------
        values, variance : ndarray of float64, shape (cells,)
            And the square of the standard error of each.
        """

        def weigh(picture: FloatArray, noise: FloatArray) -> FloatArray:
            mean = _blurred(picture, _AROUND_CELLS)
            varies = _blurred((picture - mean) ** 2, _AROUND_CELLS)
            kept = 1.0 - np.divide(_blurred(noise, _AROUND_CELLS), varies, out=np.ones_like(varies), where=varies > 0.0)
            return np.asarray(mean + np.clip(kept, 0.0, 1.0) * (picture - mean))

        return self._map_by_map(weigh, values, variance)

    def _map_by_map(self, work: Callable[..., NDArray[Any]], *values: FloatArray) -> FloatArray:
        result = np.empty(self.cells)
        for offset, rows, columns in self.cells_at:
            part = slice(offset, offset + rows * columns)
            result[part] = work(*(each[part].reshape(rows, columns) for each in values)).ravel()
        return result

    def coordinates(self, points: FloatArray, owner: IntArray) -> tuple[FloatArray, FloatArray]:
        """Where points (n, 3) lie in their surfaces: shares of ``along`` and ``across``, each (n,)."""
        offset = points - self.origin[owner]
        a, b = self.along[owner], self.across[owner]
        aa, ab, bb = (np.einsum("ij,ij->i", u, v) for u, v in ((a, a), (a, b), (b, b)))
        oa, ob = np.einsum("ij,ij->i", offset, a), np.einsum("ij,ij->i", offset, b)
        determinant = aa * bb - ab * ab
        return (oa * bb - ob * ab) / determinant, (ob * aa - oa * ab) / determinant


def assemble(parts: PatchList) -> Patches:
    """Put the collected surfaces into arrays."""
    origin, along, across = (np.array(values) for values in (parts.origins, parts.along, parts.across))
    normal = np.cross(along, across)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shapes = np.array([texture.shape for texture in parts.textures], dtype=np.int64)
    texture_at = np.column_stack([_offsets(shapes[:, 0] * shapes[:, 1]), shapes])
    cell = np.array(parts.cell_m)
    rows, columns = (
        np.clip(np.ceil(np.linalg.norm(edge, axis=1) / cell), 1, 4096).astype(np.int64) for edge in (across, along)
    )
    return Patches(
        origin,
        along,
        across,
        normal,
        np.array(parts.triangle, dtype=bool),
        np.concatenate([texture.ravel() for texture in parts.textures]).astype(np.float32),
        texture_at,
        np.column_stack([_offsets(rows * columns), rows, columns]),
        np.array([float(texture.mean()) for texture in parts.textures]),
        np.array(parts.source, dtype=np.int64),
        tuple(zip(parts.source_names, parts.source_kinds, parts.source_strength, strict=True)),
    )


def look_up(values: NDArray[np.float32], table: IntArray, owner: IntArray, s: FloatArray, t: FloatArray) -> NDArray[np.float32]:
    """Bilinear values at shares ``s``, ``t`` of surfaces; the edges' values hold beyond the centres of the outermost cells.

    Parameters
    ----------
    values : ndarray of float32, shape (m,)
    table : ndarray of int64, shape (n, 3)
        Offset, rows and columns.
    owner : ndarray of int64, shape (k,)
    s, t : ndarray of float64, shape (k,)
    """
    offset, rows, columns = table[owner].T
    x = np.clip(s * columns - 0.5, 0.0, columns - 1.0)
    y = np.clip(t * rows - 0.5, 0.0, rows - 1.0)
    x0, y0 = x.astype(np.int64), y.astype(np.int64)
    x1, y1 = np.minimum(x0 + 1, columns - 1), np.minimum(y0 + 1, rows - 1)
    fx, fy = (x - x0).astype(np.float32), (y - y0).astype(np.float32)
    low = values[offset + y0 * columns + x0] * (1 - fx) + values[offset + y0 * columns + x1] * fx
    high = values[offset + y1 * columns + x0] * (1 - fx) + values[offset + y1 * columns + x1] * fx
    return np.asarray(low * (1 - fy) + high * fy, dtype=np.float32)


def _blurred(picture: NDArray[Any], sigma: float) -> NDArray[Any]:
    if picture.size == 1:
        return picture
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE))


def _offsets(sizes: IntArray) -> IntArray:
    return np.concatenate([[0], np.cumsum(sizes)[:-1]])

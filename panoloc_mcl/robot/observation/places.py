"""The places of a map: where they are, which are neighbours, and how votes are read between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from panoloc_mcl.robot.synthesis.spacing import LEAST_REACH_M, local_spacings, usual_spacing

Float64 = NDArray[np.float64]

_NEIGHBOURS = 4
_CELLS_PER_SPACING = 20
_MAX_CELLS = 4_000_000
_CELLS_AT_ONCE = 100_000
# So many places are looked at one by one.
_FEW = 4096


@dataclass(frozen=True, eq=False)
class PlaceRaster:
    """For every cell of a raster over the map, the places around it and their weights (see `Places.raster`)."""

    origin: tuple[float, float]
    cell: float
    shape: tuple[int, int]
    neighbours: NDArray[np.int32]
    weights: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Places:
    """Positions that votes are given to.

    Parameters
    ----------
    positions : float64 (k, 2)
        Metres, map frame.
    references : float64 (n, 2), optional
        Where the references were taken, when the places are others: a report names a reference.
    least_reach : float
        How far from a place the map holds at the least, metres: where the places are the references, a robot drives beside their
        tracks, too; virtual places lie there already.
    """

    positions: Float64
    references: Float64 | None = None
    least_reach: float = LEAST_REACH_M

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def spacing(self) -> float:
        """Median distance of a place to its nearest neighbour, metres; 1.0 for a single place."""
        return usual_spacing(self.positions)

    @cached_property
    def reaches(self) -> Float64:
        """How far from each place the map still holds, float64 (k,), metres.

        At least one spacing, so that the middle of a grid's cell is covered, and farther where places are sparse.
        """
        least = max(self.spacing, self.least_reach)
        return np.clip(local_spacings(self.positions), least, max(2.0 * self.spacing, least))

    @cached_property
    def reach(self) -> float:
        """The farthest of them, metres."""
        return float(self.reaches.max())

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.positions)

    def nearest_reference(self, position: Float64) -> int:
        """Index of the reference nearest to a position (2,)."""
        known = self.positions if self.references is None else self.references
        # A search tree pays for many.
        if self.references is None and len(known) > _FEW:
            return int(self.nearest(position[None])[0])
        off = known - position
        return int(np.argmin(np.einsum("ij,ij->i", off, off)))

    def within(self, position: Float64, metres: float) -> NDArray[np.int64]:
        """Places so near to a position (2,), int64, the nearest one at least."""
        found = np.array(self._tree.query_ball_point(position, metres), dtype=np.int64)
        return found if len(found) else self.nearest(position[None])

    def nearest(self, positions: Float64) -> NDArray[np.int64]:
        """Index of the place nearest to each position (n, 2)."""
        return np.asarray(self._tree.query(positions)[1], dtype=np.int64)

    @cached_property
    def raster(self) -> PlaceRaster:
        """The look-up that a particle reads.

        Weights are those of Franke & Little (modified Shepard): ``(R - d) / (R d)`` with R the distance of the first place that is
        no longer used, so they are continuous where the set of neighbours changes, and 1 at the place itself. Cells farther from
        every place than its `reaches` are off the map and have weight 0.
        """
        first_place, high = self.positions.min(axis=0), self.positions.max(axis=0) + self.reach
        cell = self.spacing / _CELLS_PER_SPACING
        cell = max(cell, float(np.sqrt(np.prod(high - first_place + self.reach) / _MAX_CELLS)))
        # The places of a grid lie in the middle of their cells.
        low = first_place - (np.ceil(self.reach / cell) + 0.5) * cell
        columns, rows = (int(n) for n in np.maximum(np.ceil((high - low) / cell), 1))
        x = low[0] + (np.arange(columns) + 0.5) * cell
        y = low[1] + (np.arange(rows) + 0.5) * cell
        used = min(_NEIGHBOURS, len(self))
        # Memory of cells far from all places is not touched.
        neighbours = np.zeros((rows * columns, used), dtype=np.int32)
        weights = np.zeros((rows * columns, used), dtype=np.float32)
        occupied = np.zeros((rows, columns), dtype=np.uint8)
        at = ((self.positions - low) / cell).astype(np.int64)
        occupied[at[:, 1], at[:, 0]] = 1
        # Place and point lie anywhere in their cells; and one more for rounding.
        beside = int(np.ceil(self.reach / cell)) + 2
        near = maximum_filter(occupied, size=2 * beside + 1, mode="constant")
        # Row by row of cells: the search needs ten times the memory of its result.
        together = max(1, _CELLS_AT_ONCE // columns)
        for first in range(0, rows, together):
            row, column = np.nonzero(near[first : first + together])
            if len(row):
                cells = (first + row) * columns + column
                neighbours[cells], weights[cells] = self.around(np.column_stack([x[column], y[first + row]]))
        return PlaceRaster((float(low[0]), float(low[1])), cell, (rows, columns), neighbours, weights)

    @cached_property
    def covered(self) -> NDArray[np.int64]:
        """Cells of the raster that lie on the map."""
        return np.flatnonzero(self.raster.weights.any(axis=1))

    def around(self, centres: Float64) -> tuple[NDArray[np.int64], Float64]:
        """Nearest places of points (m, 2) and their weights, (m, neighbours) each."""
        wanted = min(_NEIGHBOURS + 1, len(self))
        found = self._tree.query(centres, k=wanted)
        distances, indices = (np.asarray(part).reshape(len(centres), wanted) for part in found)
        used = min(_NEIGHBOURS, len(self))
        # With as few places as neighbours there is no first unused one; the weights then end a little beyond the reach.
        radius = distances[:, used : used + 1] if wanted > used else np.maximum(distances[:, -1:], self.reach) * 1.5
        near, radius = np.maximum(distances[:, :used], 1e-6), np.maximum(radius, 1e-6)
        weights = np.maximum(radius - near, 0.0) / (radius * near)
        totals = weights.sum(axis=1, keepdims=True)
        # Neighbours all exactly as far as the first unused one: equal weights.
        weights = np.where(totals > 0.0, weights / np.where(totals > 0.0, totals, 1.0), 1.0 / used)
        weights[~(distances[:, :used] <= self.reaches[indices[:, :used]]).any(axis=1)] = 0.0
        return indices[:, :used], weights

    def sample_uniform(self, count: int, rng: np.random.Generator) -> Float64:
        """Positions drawn uniformly over the map, float64 (count, 2), metres."""
        raster = self.raster
        chosen = self.covered[rng.integers(len(self.covered), size=count)]
        rows, columns = np.divmod(chosen, raster.shape[1])
        offset = rng.random((count, 2))
        x = raster.origin[0] + (columns + offset[:, 0]) * raster.cell
        y = raster.origin[1] + (rows + offset[:, 1]) * raster.cell
        return np.stack([x, y], axis=-1)

    def contains(self, positions: Float64) -> NDArray[np.bool_]:
        """Which positions (n, 2) lie on the map, bool (n,)."""
        used = min(_NEIGHBOURS, len(self))
        distances, near = (np.asarray(part).reshape(-1, used) for part in self._tree.query(positions, k=used))
        return np.asarray((distances <= self.reaches[near]).any(axis=1))

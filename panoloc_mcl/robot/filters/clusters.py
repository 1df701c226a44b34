"""Hypotheses among weighted particles: connected cells of a grid over position and heading.

Particles are looked at twice, once for their cell and once for the cell's moments; all else is done with cells, of which there are
few. So a million particles cost hardly more than finding them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.kernels.particles import cell_moments, cells_of, link_cells, merge_cells

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

_CELL_M = 0.4
_HEADING_CELLS = 24
# Cells below this share of the heaviest one's mass belong to a cluster that they touch, but do not link two.
_LINKING_SHARE = 0.01
# Grids of up to so many cells are counted in a table, larger ones by sorting.
_TABLE_CELLS = 1 << 16


@dataclass(frozen=True, eq=False)
class Grid:
    """The cells that hold particles.

    Parameters
    ----------
    origin : (float, float)
        Corner, metres.
    rows, turns : int
        Cells along y and around the circle; cell number = (column * rows + row) * turns + turn.
    occupied : int64 (m,)
        Numbers of the cells with particles, rising.
    keys : int64 (n,)
        Cell number of each particle, or what stands for it in ``table``.
    table : int64 (k,)
        Index in ``occupied`` by key.
    """

    origin: tuple[float, float]
    rows: int
    turns: int
    occupied: Int64
    keys: Int64
    table: Int64


def grid_of(particles: Float64, cell_m: float, turns: int) -> Grid:
    """The grid around particles (3, n), C order: rows x, y, heading."""
    x, y = (np.floor(particles[axis].min() / cell_m) for axis in (0, 1))
    columns, rows = (int(particles[axis].max() / cell_m - low) + 3 for axis, low in ((0, x), (1, y)))
    # A rim of one cell, so that neighbours of a cell never are those of the next row.
    origin = (float(x - 1.0) * cell_m, float(y - 1.0) * cell_m)
    cells = columns * rows * turns
    if cells > max(_TABLE_CELLS, 4 * particles.shape[1]):
        keys, _ = cells_of(particles, *origin, cell_m, rows, turns, 0)
        occupied, slots = np.unique(keys, return_inverse=True)
        return Grid(origin, rows, turns, occupied, slots, np.arange(len(occupied)))
    keys, marked = cells_of(particles, *origin, cell_m, rows, turns, cells)
    occupied = np.flatnonzero(marked)
    table = np.zeros(cells, dtype=np.int64)
    table[occupied] = np.arange(len(occupied))
    return Grid(origin, rows, turns, occupied, keys, table)


def find_clusters(poses: Float64, weights: Float64, most: int = 5) -> tuple[Cluster, ...]:
    """Clusters by falling mass; particles in the same or touching cells (0.4 m, 15 degrees) belong together.

    The few stray particles between two hypotheses do not join them, however many particles there are.

    Parameters
    ----------
    poses : float64 (n, 3)
        Metres, radians.
    weights : float64 (n,)
        Sum 1.
    most : int
        How many are returned.
    """
    particles = np.ascontiguousarray(poses.T)
    grid = grid_of(particles, _CELL_M, _HEADING_CELLS)
    place, turn = np.divmod(grid.occupied, grid.turns)
    centres = (np.stack(np.divmod(place, grid.rows), axis=-1) + 0.5) * _CELL_M
    moments = cell_moments(particles, weights, grid.keys, grid.table, centres, *grid.origin, grid.turns)
    heavy = moments[:, 0] >= _LINKING_SHARE * moments[:, 0].max()
    labels = link_cells(grid.occupied, heavy, grid.rows, grid.turns)
    headings = (turn + 0.5) * (2.0 * np.pi / grid.turns) - np.pi
    origins = np.column_stack([centres + grid.origin, headings])
    masses, means, covariances = merge_cells(labels, int(labels.max()) + 1, origins, moments)
    # Equal masses: the one whose cells come first, so that the order never depends on the sorting algorithm.
    ranking = np.argsort(-masses, kind="stable")[:most]
    return tuple(Cluster(means[label], covariances[label], float(masses[label])) for label in ranking if masses[label] > 0.0)

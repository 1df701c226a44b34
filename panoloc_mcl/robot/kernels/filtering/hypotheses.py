"""Hypotheses among weighted particles: cells of a grid over position and heading, their moments, and which of them belong together.

Particles are looked at once; all else is done with cells, of which there are few.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel, vector_kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt32 = NDArray[np.uint32]
Bool = NDArray[np.bool_]

_BLOCK = 512
# Comparisons side by side: one need not wait for the one just before it.
_ABREAST = 64
_HALF, _OF_24_BITS = np.float32(0.5), np.float32(2.0**-24)
# Grids of up to so many cells are looked up in a table, larger ones by searching.
_TABLE_CELLS = 1 << 16


@kernel
def hypotheses(
    x: Float32,
    y: Float32,
    turns: UInt32,
    weights: Float32,
    cell: float,
    around: int,
    linking: float,
) -> tuple[Float64, Float64, Float64]:
    """Mass, mean and covariance of the particles in cells that touch (see `link_cells` and `merge_cells`).

    Parameters
    ----------
    x, y, turns, weights, cell, around
        See `occupied_cells`.
    linking : float
        Cells below this share of the heaviest one's weight do not link two.
    """
    occupied, moments, first_column, first_row, rows = occupied_cells(x, y, turns, weights, cell, around)
    labels = link_cells(occupied, moments[:, 0] >= linking * moments[:, 0].max(), rows, around)
    centres = np.empty((occupied.shape[0], 3))
    for one in range(occupied.shape[0]):
        place = occupied[one] // around
        centres[one, 0] = (first_column + place // rows + 0.5) * cell
        centres[one, 1] = (first_row + place % rows + 0.5) * cell
        centres[one, 2] = (occupied[one] % around + 0.5) * (2.0 * np.pi / around)
    return merge_cells(labels, labels.max() + 1, centres, moments)


@vector_kernel
def occupied_cells(
    x: Float32,
    y: Float32,
    turns: UInt32,
    weights: Float32,
    cell: float,
    around: int,
) -> tuple[Int64, Float64, int, int, int]:
    """The cells of a grid over position and heading that hold particles, and the weighted moments of these about the cell's centre.

    Parameters
    ----------
    x, y, turns : float32 (n,) twice, uint32 (n,)
        See `kernels.particles`.
    weights : float32 (n,)
    cell : float
        Side, metres.
    around : int
        Cells around the circle; the first of these begins at heading 0.

    Returns
    -------
    occupied : int64 (m,)
        Numbers of the cells with particles, rising: (column * rows + row) * around + turn.
    moments : float64 (m, 10)
        Sums of the weight times 1, x, y, t, xx, xy, yy, xt, yt, tt; metres and radians.
    first_column, first_row : int
        Where the grid begins, in cells from the origin of the positions. Its rim is empty, so that neighbours of a cell never are
        those of the next row.
    rows : int
        Cells along y.
    """
    # In single precision, as in `in_cells`.
    per_metre = np.float32(1.0 / cell)
    (low_x, high_x), (low_y, high_y) = lowest_and_highest(x), lowest_and_highest(y)
    west, south = int(np.floor(low_x * per_metre)) - 1, int(np.floor(low_y * per_metre)) - 1
    columns, rows = int(np.floor(high_x * per_metre)) - west + 2, int(np.floor(high_y * per_metre)) - south + 2
    count, cells = turns.shape[0], columns * rows * around
    where, slots = np.empty((3, _BLOCK), dtype=np.int32), np.empty(_BLOCK, dtype=np.int64)
    offsets = np.empty((3, _BLOCK), dtype=np.float32)
    dense = cells <= max(_TABLE_CELLS, 4 * count)
    table, known = np.full(cells if dense else 1, -1, dtype=np.int32), np.empty(0, dtype=np.int64)
    if not dense:
        every = np.empty(count, dtype=np.int64)
        for start in range(0, count, _BLOCK):
            block = slice(start, min(start + _BLOCK, count))
            in_cells(x[block], y[block], turns[block], cell, around, where, offsets)
            keys_of(where, west, south, rows, around, every[block])
        known = np.unique(every)
    room = known.shape[0] if not dense else max(1, min(count, cells))
    occupied, found = np.empty(room, dtype=np.int64), known.shape[0]
    occupied[:found] = known
    # Two sets of sums by turns: a sum must not wait for the one just before it.
    sums = np.zeros(20 * room)
    for start in range(0, count, _BLOCK):
        block = slice(start, min(start + _BLOCK, count))
        in_cells(x[block], y[block], turns[block], cell, around, where, offsets)
        if dense:
            keys_of(where, west, south, rows, around, slots)
            found = slots_of(slots, block.stop - start, table, occupied, found)
        else:
            keys_of(where, west, south, rows, around, slots)
            slots[:] = np.searchsorted(known, slots)
        add_moments(slots, weights[block], offsets, sums)
    order = np.argsort(occupied[:found])
    moments = sums[: 20 * found].copy().reshape(found, 2, 10)
    return occupied[order], (moments[:, 0] + moments[:, 1])[order], west, south, rows


@vector_kernel
def lowest_and_highest(values: Float32) -> tuple[np.float32, np.float32]:
    """The ends of finite values, float32 (n,), of which there is one at least."""
    low, high = np.full(_ABREAST, values[0]), np.full(_ABREAST, values[0])
    for start in range(0, values.shape[0] - _ABREAST + 1, _ABREAST):
        part = values[start : start + _ABREAST]
        for i in range(_ABREAST):
            low[i] = part[i] if part[i] < low[i] else low[i]
            high[i] = part[i] if part[i] > high[i] else high[i]
    lowest, highest = low.min(), high.max()
    for i in range(values.shape[0] - values.shape[0] % _ABREAST, values.shape[0]):
        lowest, highest = min(lowest, values[i]), max(highest, values[i])
    return lowest, highest


@vector_kernel
def keys_of(where: Int32, west: int, south: int, rows: int, around: int, keys: Int64) -> None:
    """Numbers of cells, into int64 (n,), of their columns, rows and turns, int32 (3, n)."""
    columns, lines, turned = where[0], where[1], where[2]
    for i in range(keys.shape[0]):
        keys[i] = ((np.int64(columns[i]) - west) * rows + (np.int64(lines[i]) - south)) * around + np.int64(turned[i])


@vector_kernel
def slots_of(keys: Int64, count: int, table: Int32, occupied: Int64, found: int) -> int:
    """Turn cell numbers into slots, in the order in which cells are first met; ``table`` is -1 where none was. Returns how many."""
    for i in range(count):
        key = np.uint64(keys[i])
        if table[key] < 0:
            occupied[np.uint64(found)] = keys[i]
            table[key] = found
            found += 1
        keys[i] = np.int64(table[key])
    return found


@vector_kernel
def add_moments(slots: Int64, weights: Float32, offsets: Float32, sums: Float64) -> None:
    """Add weighted moments of particles (n,) to those of their cell, ``sums[20 slot:]``, in one or the other half of these by turns."""
    dx, dy, dt = offsets[0], offsets[1], offsets[2]
    for i in range(weights.shape[0]):
        at = np.uint64(slots[i]) * np.uint64(20) + np.uint64(i & 1) * np.uint64(10)
        w, a, b, t = np.float64(weights[i]), np.float64(dx[i]), np.float64(dy[i]), np.float64(dt[i])
        wa, wb, wt = w * a, w * b, w * t
        sums[at] += w
        sums[at + np.uint64(1)] += wa
        sums[at + np.uint64(2)] += wb
        sums[at + np.uint64(3)] += wt
        sums[at + np.uint64(4)] += wa * a
        sums[at + np.uint64(5)] += wa * b
        sums[at + np.uint64(6)] += wb * b
        sums[at + np.uint64(7)] += wa * t
        sums[at + np.uint64(8)] += wb * t
        sums[at + np.uint64(9)] += wt * t


@vector_kernel
def in_cells(x: Float32, y: Float32, turns: UInt32, cell: float, around: int, where: Int32, offsets: Float32) -> None:
    """Column, row and turn of the cell of each particle, into int32 (3, n), and where in it that lies, into float32 (3, n)."""
    side, per_metre, width = np.float32(cell), np.float32(1.0 / cell), np.float32(2.0 * np.pi / around)
    columns, rows, turned = where[0], where[1], where[2]
    dx, dy, dt = offsets[0], offsets[1], offsets[2]
    for i in range(x.shape[0]):
        column, row = np.floor(x[i] * per_metre), np.floor(y[i] * per_metre)
        columns[i], rows[i] = np.int32(column), np.int32(row)
        dx[i], dy[i] = x[i] - (column + _HALF) * side, y[i] - (row + _HALF) * side
    for i in range(x.shape[0]):
        turn = np.uint64(turns[i]) * np.uint64(around)
        turned[i] = np.int32(turn >> np.uint64(32))
        dt[i] = (np.float32(np.int32((turn >> np.uint64(8)) & np.uint64(0xFFFFFF))) * _OF_24_BITS - _HALF) * width


@kernel
def merge_cells(labels: Int64, count: int, origins: Float64, moments: Float64) -> tuple[Float64, Float64, Float64]:
    """Mass, mean and covariance of the particles in the cells of each label, from the cells' moments.

    Parameters
    ----------
    labels : int64 (m,)
        0 to count - 1.
    count : int
    origins : float64 (m, 3)
        Centres of the cells: metres, radians.
    moments : float64 (m, 10)
        About the centres (see `cell_moments`).

    Returns
    -------
    masses : float64 (count,)
    means : float64 (count, 3)
        Headings in [-pi, pi), averaged as turns from the heaviest cell's, so no seam is in the way. NaN where there is no mass.
    covariances : float64 (count, 3, 3)
    """
    masses, heaviest = np.zeros(count), np.full(count, -1)
    for one in range(labels.shape[0]):
        label = labels[one]
        masses[label] += moments[one, 0]
        if heaviest[label] < 0 or moments[one, 0] > moments[heaviest[label], 0]:
            heaviest[label] = one
    # Where the mean of each cell lies from that of the heaviest one of its label.
    residuals, means = np.zeros((labels.shape[0], 3)), np.zeros((count, 3))
    for one in range(labels.shape[0]):
        label, mass, middle = labels[one], moments[one, 0], heaviest[labels[one]]
        if mass <= 0.0:
            continue
        for axis in range(3):
            here = origins[one, axis] + moments[one, 1 + axis] / mass
            there = origins[middle, axis] + moments[middle, 1 + axis] / moments[middle, 0]
            residuals[one, axis] = here - there
        residuals[one, 2] -= 2.0 * np.pi * np.floor((residuals[one, 2] + np.pi) / (2.0 * np.pi))
        for axis in range(3):
            means[label, axis] += mass / masses[label] * residuals[one, axis]
    covariances = np.zeros((count, 3, 3))
    for one in range(labels.shape[0]):
        label, mass = labels[one], moments[one, 0]
        if mass <= 0.0:
            continue
        # The moments after the mass and the means: xx, xy, yy, xt, yt, tt.
        at = 4
        for column in range(3):
            for row in range(column + 1):
                within = moments[one, at] / mass - moments[one, 1 + row] / mass * (moments[one, 1 + column] / mass)
                between = (residuals[one, row] - means[label, row]) * (residuals[one, column] - means[label, column])
                covariances[label, row, column] += mass / masses[label] * (within + between)
                covariances[label, column, row] = covariances[label, row, column]
                at += 1
    for label in range(count):
        for axis in range(3):
            middle = heaviest[label]
            means[label, axis] += origins[middle, axis] + moments[middle, 1 + axis] / moments[middle, 0]
            # Rounding may leave a spread of nothing a hair below it.
            covariances[label, axis, axis] = max(covariances[label, axis, axis], 0.0)
        means[label, 2] -= 2.0 * np.pi * np.floor((means[label, 2] + np.pi) / (2.0 * np.pi))
    return masses, means, covariances


@kernel
def link_cells(occupied: Int64, heavy: Bool, rows: int, turns: int) -> Int64:
    """Label the cells of a grid so that heavy ones that touch, and light ones that touch a heavy one, have the same label.

    Parameters
    ----------
    occupied : int64 (m,)
        Cell numbers (see `cells_of`), rising; none at the rim of the grid.
    heavy : bool (m,)
    rows, turns : int

    Returns
    -------
    int64 (m,)
        From 0, in the order of the first cell that has it.
    """
    m = occupied.shape[0]
    root = np.arange(m)
    joined = np.full(m, -1)
    for one in range(m):
        place, turn = occupied[one] // turns, occupied[one] % turns
        for dx in range(2):
            for dy in range(-1, 2):
                for dt in range(-1, 2):
                    # Half of the neighbours; the other half are the same pairs the other way round.
                    if dx == 0 and (dy < 0 or (dy == 0 and dt <= 0)):
                        continue
                    wanted = (place + dx * rows + dy) * turns + (turn + dt) % turns
                    other = np.searchsorted(occupied, wanted)
                    if other == m or occupied[other] != wanted:
                        continue
                    if heavy[one] and heavy[other]:
                        a, b = one, other
                        while root[a] != a:
                            a = root[a]
                        while root[b] != b:
                            b = root[b]
                        root[max(a, b)] = min(a, b)
                    elif heavy[other]:
                        joined[one] = other
                    elif heavy[one]:
                        joined[other] = one
    for one in range(m):
        a = joined[one] if joined[one] >= 0 else one
        while root[a] != a:
            a = root[a]
        joined[one] = a
    labels, known, newest = np.empty(m, dtype=np.int64), np.full(m, -1), 0
    for one in range(m):
        if known[joined[one]] < 0:
            known[joined[one]] = newest
            newest += 1
        labels[one] = known[joined[one]]
    return labels

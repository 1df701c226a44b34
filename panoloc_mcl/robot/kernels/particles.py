"""Inner loops of the particle filter. Particles are the columns of a float64 array (3, n): rows x, y, heading.

Rows, because the compiler then works on several particles at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import sine_cosine
from panoloc_mcl.robot.kernels.jit import kernel, vector_kernel
from panoloc_mcl.robot.kernels.random import normal_pair, philox

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

# Particles whose places in the field are worked out before any is looked up.
_BLOCK = 512


@vector_kernel
def propagate(
    particles: Float64,
    first_turn: float,
    along: float,
    across: float,
    last_turn: float,
    sd_first_turn: float,
    sd_along: float,
    sd_across: float,
    sd_last_turn: float,
    key: int,
    step: int,
    first: int,
    last: int,
) -> Float64:
    """Turn, drive, turn: every particle with Gaussian noise of its own (Thrun, Burgard & Fox, "Probabilistic Robotics", table 5.6).

    Parameters
    ----------
    particles : float64 (3, n)
        Metres and radians.
    first_turn, along, across, last_turn : float
        The motion: a turn into the direction of travel, the way along and across it (to its left), and another turn.
    sd_first_turn, sd_along, sd_across, sd_last_turn : float
        Standard deviations of the four.
    key, step : int
        Of the random numbers, which each particle has for its index (see `kernels.random`).
    first, last : int
        Particles ``first`` to ``last - 1`` are moved.

    Returns
    -------
    float64 (3, last - first)
        Headings in [-pi, pi).
    """
    count = last - first
    moved = np.empty((3, count))
    word = np.uint64(0xFFFFFFFF)
    k0, k1 = np.uint64(key) & word, np.uint64(key) >> np.uint64(32)
    for i in range(count):
        index = np.uint64(first + i)
        words = philox(index & word, index >> np.uint64(32), np.uint64(step), np.uint64(0), k0, k1)
        n0, n1 = normal_pair(words[0], words[1])
        n2, n3 = normal_pair(words[2], words[3])
        direction = particles[2, first + i] + (first_turn + sd_first_turn * n0)
        s, c = sine_cosine(direction)
        ahead = along + sd_along * n1
        aside = across + sd_across * n2
        moved[0, i] = particles[0, first + i] + (c * ahead - s * aside)
        moved[1, i] = particles[1, first + i] + (s * ahead + c * aside)
        heading = direction + (last_turn + sd_last_turn * n3)
        heading -= 2.0 * np.pi * np.floor((heading + np.pi) / (2.0 * np.pi))
        # Rounding may leave the seam on the wrong side.
        heading = max(heading, -np.pi)
        moved[2, i] = heading if heading < np.pi else -np.pi
    return moved


@vector_kernel
def read_field(
    particles: Float64,
    scores: Float32,
    neighbours: Int32,
    weights: Float32,
    origin_x: float,
    origin_y: float,
    cell: float,
    cells_x: int,
    cells_y: int,
) -> Float32:
    """Score of every particle: linear over headings, weighted over the places around it.

    Parameters
    ----------
    particles : float64 (3, n)
    scores : float32 (h, k)
        Scores at h equally spaced headings (heading i is 2 pi i / h) and k places.
    neighbours : int32 (cells_y * cells_x, m)
        Places around each cell of a raster over the map.
    weights : float32, same shape
        Their weights; a cell off the map has only zeros.
    origin_x, origin_y, cell : float
        Corner and side of the raster's cells, metres.

    Returns
    -------
    float32 (n,)
        0 off the map.
    """
    n_headings, n_places, around = scores.shape[0], scores.shape[1], neighbours.shape[1]
    per_radian, per_metre = n_headings / (2.0 * np.pi), 1.0 / cell
    out = np.zeros(particles.shape[1], dtype=np.float32)
    votes, places, shares = scores.ravel(), neighbours.ravel(), weights.ravel()
    cells, rows, fractions = np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.float32)
    for start in range(0, particles.shape[1], _BLOCK):
        count = min(_BLOCK, particles.shape[1] - start)
        # Where to look: arithmetic alone, so for several particles at once; of whole numbers, processors convert several only to 32
        # bits.
        for i in range(count):
            column = np.floor((particles[0, start + i] - origin_x) * per_metre)
            row = np.floor((particles[1, start + i] - origin_y) * per_metre)
            inside = (column >= 0.0) & (row >= 0.0) & (column < cells_x) & (row < cells_y)
            cells[i] = np.int32(row * cells_x + column if inside else -1.0)
            position = particles[2, start + i] * per_radian
            lower = np.floor(position)
            fractions[i] = np.float32(position - lower)
            rows[i] = np.int32(lower - n_headings * np.floor(lower / n_headings))
        # Looking: memory alone. Unsigned indices, or each would be asked whether it counts from the end.
        for i in range(count):
            if cells[i] < 0:
                continue
            first = np.uint64(rows[i]) * np.uint64(n_places)
            second = first + np.uint64(n_places) if rows[i] + 1 < n_headings else np.uint64(0)
            j = np.uint64(cells[i]) * np.uint64(around)
            if around == 4:
                # The usual case written out: the sums then run side by side.
                j1, j2, j3 = j + np.uint64(1), j + np.uint64(2), j + np.uint64(3)
                p, q = np.uint64(places[j]), np.uint64(places[j1])
                r, t = np.uint64(places[j2]), np.uint64(places[j3])
                before = (shares[j] * votes[first + p] + shares[j1] * votes[first + q]) + (
                    shares[j2] * votes[first + r] + shares[j3] * votes[first + t]
                )
                after = (shares[j] * votes[second + p] + shares[j1] * votes[second + q]) + (
                    shares[j2] * votes[second + r] + shares[j3] * votes[second + t]
                )
            else:
                before, after = np.float32(0.0), np.float32(0.0)
                for k in range(around):
                    one = j + np.uint64(k)
                    before += shares[one] * votes[first + np.uint64(places[one])]
                    after += shares[one] * votes[second + np.uint64(places[one])]
            out[start + i] = before + fractions[i] * (after - before)
    return out


@vector_kernel
def cells_of(
    particles: Float64, origin_x: float, origin_y: float, cell: float, rows: int, turns: int, cells: int
) -> tuple[Int64, Bool]:
    """Number of the grid cell over position and heading that each particle lies in: (column * rows + row) * turns + turn.

    Parameters
    ----------
    particles : float64 (3, n)
    origin_x, origin_y : float
        Corner of the grid; no particle lies below it.
    cell : float
        Side, metres.
    rows, turns : int
        Cells along y, and around the circle; the first of these begins at -pi.
    cells : int
        Cells of the grid; 0 = do not mark them.

    Returns
    -------
    keys : int64 (n,)
    marked : bool (cells,)
        Which cells hold particles.
    """
    keys, marked = np.empty(particles.shape[1], dtype=np.int64), np.zeros(cells, dtype=np.bool_)
    per_metre, per_radian = 1.0 / cell, turns / (2.0 * np.pi)
    for i in range(particles.shape[1]):
        column = int((particles[0, i] - origin_x) * per_metre)
        row = int((particles[1, i] - origin_y) * per_metre)
        turn = int(np.floor((particles[2, i] + np.pi) * per_radian))
        if not 0 <= turn < turns:
            turn %= turns
        keys[i] = (column * rows + row) * turns + turn
        if cells > 0:
            marked[keys[i]] = True
    return keys, marked


@vector_kernel
def cell_moments(
    particles: Float64,
    weights: Float64,
    keys: Int64,
    table: Int64,
    centres: Float64,
    origin_x: float,
    origin_y: float,
    turns: int,
) -> Float64:
    """Weighted moments of the particles in each cell of a grid, about the cell's centre.

    Parameters
    ----------
    particles : float64 (3, n)
    weights : float64 (n,)
    keys : int64 (n,)
        Cell number of each particle.
    table : int64 (k,)
        By cell number, which of the m cells it is.
    centres : float64 (m, 2)
        Position of the cells' centres from the origin, metres.
    origin_x, origin_y : float
    turns : int
        Cells around the circle; moments of the heading are about the middle of its cell.

    Returns
    -------
    float64 (m, 10)
        Sums of the weight times 1, x, y, t, xx, xy, yy, xt, yt, tt.
    """
    out = np.zeros((centres.shape[0], 10))
    width, per_radian = 2.0 * np.pi / turns, turns / (2.0 * np.pi)
    for i in range(particles.shape[1]):
        slot = table[keys[i]]
        w = weights[i]
        x = (particles[0, i] - origin_x) - centres[slot, 0]
        y = (particles[1, i] - origin_y) - centres[slot, 1]
        turn = (particles[2, i] + np.pi) * per_radian
        t = (turn - np.floor(turn) - 0.5) * width
        out[slot, 0] += w
        out[slot, 1] += w * x
        out[slot, 2] += w * y
        out[slot, 3] += w * t
        out[slot, 4] += w * x * x
        out[slot, 5] += w * x * y
        out[slot, 6] += w * y * y
        out[slot, 7] += w * x * t
        out[slot, 8] += w * y * t
        out[slot, 9] += w * t * t
    return out


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

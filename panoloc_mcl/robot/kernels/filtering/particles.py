"""Inner loops of the particle filter: particles are moved, and read in a vote field.

Positions are two float32 (n,), metres from an origin near by, and headings uint32 (n,), in 2^-32 of a turn (see `compact_poses`):
numbers of 32 bits, because the compiler then works on eight particles at once. For that, too, loops are split into ones over few
arrays each, and blocks of particles go through small buffers that stay in the processor's first cache.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import sine_cosine
from panoloc_mcl.robot.kernels.filtering.random import normal_pairs, words_of
from panoloc_mcl.robot.kernels.filtering.weights import to_likelihoods
from panoloc_mcl.robot.kernels.jit import inlined, vector_kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
UInt32 = NDArray[np.uint32]

# Particles that go through the buffers together.
_BLOCK = 512
_PER_RADIAN = 2.0**32 / (2.0 * np.pi)
_WORD = 0xFFFFFFFF
# Of single precision, or sums would be of double.
_ZERO, _HALF, _NONE = np.float32(0.0), np.float32(0.5), np.float32(-1.0)
_HALF_CIRCLE, _OF_24_BITS = np.float32(2.0**31), np.float32(2.0**-24)


@vector_kernel
def predict(
    x: Float32, y: Float32, turns: UInt32, parts: Float64, sds: Float64, key: int, step: int, first: int, last: int
) -> None:
    """Turn, drive, turn: every particle with Gaussian noise of its own (Thrun, Burgard & Fox, "Probabilistic Robotics", table 5.6).

    Parameters
    ----------
    x, y, turns : float32 (n,) twice, uint32 (n,)
        Particles ``first`` to ``last - 1`` are moved in place.
    parts : float64 (4,)
        The motion: a turn into the direction of travel, the way along and across it (to its left), and another turn; metres, radians.
    sds : float64 (4,)
        Standard deviations of the four.
    key, step : int
        Of the random numbers, which each particle has for its index (see `random.py`).
    first, last : int
    """
    words, noise = np.empty((4, _BLOCK), dtype=np.uint32), np.empty((4, _BLOCK), dtype=np.float32)
    for start in range(first, last, _BLOCK):
        count = min(_BLOCK, last - start)
        words_of(key, step, 0, start, count, words)
        normal_pairs(words[0], words[1], noise[0], noise[1], count)
        normal_pairs(words[2], words[3], noise[2], noise[3], count)
        block = slice(start, start + count)
        turn_and_drive(x[block], y[block], turns[block], noise, parts, sds)


@vector_kernel
def turn_and_drive(x: Float32, y: Float32, turns: UInt32, noise: Float32, parts: Float64, sds: Float64) -> None:
    """The arithmetic of `predict` for at most a buffer of particles, whose standard normal numbers are float32 (4, m)."""
    # The known part of a turn is exact, whatever its noise.
    first_turn = np.uint32(np.int64(np.rint(parts[0] * _PER_RADIAN)) & np.int64(_WORD))
    last_turn = np.uint32(np.int64(np.rint(parts[3] * _PER_RADIAN)) & np.int64(_WORD))
    along, across = np.float32(parts[1]), np.float32(parts[2])
    sd_along, sd_across = np.float32(sds[1]), np.float32(sds[2])
    # In turns.
    sd_first, sd_last = np.float32(sds[0] / (2.0 * np.pi)), np.float32(sds[3] / (2.0 * np.pi))
    before, ahead, aside, after = noise[0], noise[1], noise[2], noise[3]
    for i in range(turns.shape[0]):
        direction = turned(turns[i], first_turn, in_turns(sd_first * before[i]))
        s, c = sine_cosine(direction)
        forward, left = along + sd_along * ahead[i], across + sd_across * aside[i]
        x[i] = x[i] + (c * forward - s * left)
        y[i] = y[i] + (s * forward + c * left)
        turns[i] = turned(direction, last_turn, in_turns(sd_last * after[i]))


@inlined
def turned(heading: np.uint32, by: np.uint32, noise: np.uint32) -> np.uint32:
    """Sum of three angles in 2^-32 of a turn, whole turns left out."""
    return np.uint32((np.uint64(heading) + np.uint64(by) + np.uint64(noise)) & np.uint64(_WORD))


@inlined
def in_turns(turn: np.float32) -> np.uint32:
    """A float32 number of turns in 2^-32 of one, whole turns left out."""
    # By 2^31, or half a turn would not fit a signed number.
    part = np.int32((turn - np.floor(turn + _HALF)) * _HALF_CIRCLE)
    return np.uint32((np.uint64(np.uint32(part)) * np.uint64(2)) & np.uint64(_WORD))


@vector_kernel
def read_field(
    x: Float32,
    y: Float32,
    turns: UInt32,
    scores: Float32,
    columns: Int32,
    neighbours: Int32,
    weights: Float32,
    corner_x: float,
    corner_y: float,
    cell: float,
    cells_x: int,
    cells_y: int,
) -> Float32:
    """Score of every particle: linear over headings, weighted over the places around it.

    Parameters
    ----------
    x, y, turns : float32 (n,) twice, uint32 (n,)
    scores : float32 (h, c)
        Scores at h equally spaced headings (heading i is 2 pi i / h) and c places.
    columns : int32 (k,)
        In which column of the scores each of k places is read; empty where all have one of their own, in order.
    neighbours : int32 (cells_y * cells_x, m)
        Places around each cell of a raster over the map.
    weights : float32, same shape
        Their weights; a cell off the map has only zeros.
    corner_x, corner_y, cell : float
        Corner (from the origin of the positions) and side of the raster's cells, metres.

    Returns
    -------
    float32 (n,)
        0 off the map.
    """
    out = np.empty(turns.shape[0], dtype=np.float32)
    cells, rows, fractions = np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.uint32), np.empty(_BLOCK, np.float32)
    for start in range(0, turns.shape[0], _BLOCK):
        block = slice(start, min(start + _BLOCK, turns.shape[0]))
        where_to_look(
            x[block],
            y[block],
            turns[block],
            scores.shape[0],
            corner_x,
            corner_y,
            cell,
            cells_x,
            cells_y,
            cells,
            rows,
            fractions,
        )
        look(scores, columns, neighbours, weights, cells, rows, fractions, out[block])
    return out


@vector_kernel
def likelihoods_there(
    x: Float32,
    y: Float32,
    turns: UInt32,
    scores: Float32,
    columns: Int32,
    neighbours: Int32,
    weights: Float32,
    corner_x: float,
    corner_y: float,
    cell: float,
    cells_x: int,
    cells_y: int,
    best: float,
    tolerance: float,
    sharpness: float,
    floor: float,
    out: Float32,
) -> None:
    """Likelihood by the scores of every particle (see `read_field` and `weights.likelihoods`), into float32 (n,), in one pass."""
    cells, rows, fractions = np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.uint32), np.empty(_BLOCK, np.float32)
    for start in range(0, turns.shape[0], _BLOCK):
        block = slice(start, min(start + _BLOCK, turns.shape[0]))
        where_to_look(
            x[block],
            y[block],
            turns[block],
            scores.shape[0],
            corner_x,
            corner_y,
            cell,
            cells_x,
            cells_y,
            cells,
            rows,
            fractions,
        )
        look(scores, columns, neighbours, weights, cells, rows, fractions, out[block])
        to_likelihoods(out[block], best, tolerance, sharpness, floor)


@vector_kernel
def where_to_look(
    x: Float32,
    y: Float32,
    turns: UInt32,
    headings: int,
    corner_x: float,
    corner_y: float,
    cell: float,
    cells_x: int,
    cells_y: int,
    cells: Int32,
    rows: UInt32,
    fractions: Float32,
) -> None:
    """Cell of the raster (-1 off it), row of the scores, and the way to the next row, of every particle, into (m,) each.

    Arithmetic alone, so for several particles at once.
    """
    x0, y0, per_metre = np.float32(corner_x), np.float32(corner_y), np.float32(1.0 / cell)
    columns, lines = np.float32(cells_x), np.float32(cells_y)
    for i in range(x.shape[0]):
        column, row = np.floor((x[i] - x0) * per_metre), np.floor((y[i] - y0) * per_metre)
        inside = (column >= _ZERO) & (row >= _ZERO) & (column < columns) & (row < lines)
        cells[i] = np.int32(row * columns + column if inside else _NONE)
    for i in range(x.shape[0]):
        position = np.uint64(turns[i]) * np.uint64(headings)
        rows[i] = np.uint32(position >> np.uint64(32))
        fractions[i] = np.float32(np.int32((position >> np.uint64(8)) & np.uint64(0xFFFFFF))) * _OF_24_BITS


@vector_kernel
def look(
    scores: Float32,
    columns: Int32,
    neighbours: Int32,
    weights: Float32,
    cells: Int32,
    rows: UInt32,
    fractions: Float32,
    out: Float32,
) -> None:
    """The scores there, into float32 (m,): memory alone. Unsigned indices, or each would be asked whether it counts from the end."""
    n_places, around, end = np.uint64(scores.shape[1]), neighbours.shape[1], np.uint64(scores.size)
    votes, places, shares, chosen = scores.ravel(), neighbours.ravel(), weights.ravel(), columns.size > 0
    for i in range(out.shape[0]):
        out[i] = _ZERO
        if cells[i] < 0:
            continue
        first = np.uint64(rows[i]) * n_places
        second = first + n_places
        second = second if second < end else np.uint64(0)
        j = np.uint64(cells[i]) * np.uint64(around)
        if around == 4:
            # The usual case written out: the sums then run side by side.
            j1, j2, j3 = j + np.uint64(1), j + np.uint64(2), j + np.uint64(3)
            p, q = np.uint64(places[j]), np.uint64(places[j1])
            r, t = np.uint64(places[j2]), np.uint64(places[j3])
            if chosen:
                p, q, r, t = np.uint64(columns[p]), np.uint64(columns[q]), np.uint64(columns[r]), np.uint64(columns[t])
            before = (shares[j] * votes[first + p] + shares[j1] * votes[first + q]) + (
                shares[j2] * votes[first + r] + shares[j3] * votes[first + t]
            )
            after = (shares[j] * votes[second + p] + shares[j1] * votes[second + q]) + (
                shares[j2] * votes[second + r] + shares[j3] * votes[second + t]
            )
        else:
            before, after = _ZERO, _ZERO
            for k in range(around):
                one = j + np.uint64(k)
                p = np.uint64(places[one])
                p = np.uint64(columns[p]) if chosen else p
                before += shares[one] * votes[first + p]
                after += shares[one] * votes[second + p]
        out[i] = before + fractions[i] * (after - before)


@vector_kernel
def take(
    x: Float32, y: Float32, turns: UInt32, indices: NDArray[np.int64], to_x: Float32, to_y: Float32, to_turns: UInt32
) -> None:
    """Copy the particles of ``indices`` (m,), which are known to be in range, into other arrays (m,)."""
    # An array at a time: two thirds of the time of all three at once.
    for i in range(indices.shape[0]):
        to_x[i] = x[np.uint64(indices[i])]
    for i in range(indices.shape[0]):
        to_y[i] = y[np.uint64(indices[i])]
    for i in range(indices.shape[0]):
        to_turns[i] = turns[np.uint64(indices[i])]

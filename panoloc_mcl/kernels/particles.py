"""Inner loops of the particle filter. A particle is a row ``(x, y, theta)`` of a float64 array of shape (n, 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.kernels.jit import kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]


@kernel
def propagate(
    poses: Float64, dx: float, dy: float, turn: float, sd_position: float, sd_heading: float, normals: Float64
) -> Float64:
    """Move every particle by an odometry increment with Gaussian noise.

    Parameters
    ----------
    poses : float64 (n, 3)
    dx, dy, turn : float
        Increment in the robot's frame at its start, metres and radians.
    sd_position, sd_heading : float
        Standard deviations, metres and radians; both zero move all particles alike.
    normals : float64 (n, 3)
        Standard normal numbers.

    Returns
    -------
    float64 (n, 3)
        Headings in [-pi, pi).
    """
    moved = np.empty_like(poses)
    for i in range(poses.shape[0]):
        heading_noise = sd_heading * normals[i, 2]
        # A turn that odometry misjudged was, on average, half made when the robot drove.
        direction = poses[i, 2] + 0.5 * heading_noise
        c, s = np.cos(direction), np.sin(direction)
        ex = dx + sd_position * normals[i, 0]
        ey = dy + sd_position * normals[i, 1]
        moved[i, 0] = poses[i, 0] + c * ex - s * ey
        moved[i, 1] = poses[i, 1] + s * ex + c * ey
        heading = poses[i, 2] + turn + heading_noise
        if not -np.pi <= heading < np.pi:
            heading -= 2.0 * np.pi * np.floor((heading + np.pi) / (2.0 * np.pi))
            # Rounding may leave the seam on the wrong side.
            heading = max(heading, -np.pi) if heading < np.pi else -np.pi
        moved[i, 2] = heading
    return moved


@kernel
def read_field(
    poses: Float64,
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
    poses : float64 (n, 3)
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
    n_headings = scores.shape[0]
    per_radian = n_headings / (2.0 * np.pi)
    out = np.zeros(poses.shape[0], dtype=np.float32)
    for i in range(poses.shape[0]):
        column = int(np.floor((poses[i, 0] - origin_x) / cell))
        row = int(np.floor((poses[i, 1] - origin_y) / cell))
        if column < 0 or row < 0 or column >= cells_x or row >= cells_y:
            continue
        index = row * cells_x + column
        position = poses[i, 2] * per_radian
        lower = np.floor(position)
        fraction = np.float32(position - lower)
        first = int(lower) % n_headings
        second = (first + 1) % n_headings
        total = np.float32(0.0)
        for j in range(neighbours.shape[1]):
            place = neighbours[index, j]
            here = scores[first, place] + fraction * (scores[second, place] - scores[first, place])
            total += weights[index, j] * here
        out[i] = total
    return out


@kernel
def systematic_resample(weights: Float64, offset: float, count: int) -> Int64:
    """Systematic resampling (Kitagawa 1996).

    Parameters
    ----------
    weights : float64 (n,)
        Non-negative, sum > 0; need not be normalised.
    offset : float
        One uniform random number in [0, 1).
    count : int
        How many indices to draw.

    Returns
    -------
    int64 (count,)
        Indices in rising order; index i comes floor or ceil of count * weight_i / sum times.
    """
    total = 0.0
    for i in range(weights.shape[0]):
        total += weights[i]
    last = 0
    for i in range(weights.shape[0]):
        if weights[i] > 0.0:
            last = i
    indices = np.empty(count, dtype=np.int64)
    i = 0
    cumulative = weights[0]
    for k in range(count):
        target = (k + offset) * total / count
        # Rounding may leave the last target above the sum: it belongs to the last particle that has any weight.
        while cumulative <= target and i < last:
            i += 1
            cumulative += weights[i]
        indices[k] = i
    return indices

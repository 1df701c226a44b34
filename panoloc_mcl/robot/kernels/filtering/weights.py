"""From votes to likelihoods and to weights: one pass over the particles each, several at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import exponential
from panoloc_mcl.robot.kernels.jit import inlined, kernel, vector_kernel

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

_NONE, _LEAST = np.float32(0.0), np.finfo(np.float32).tiny


@inlined
def fallen(votes: np.float32, most: np.float32, steepness: np.float32) -> np.float32:
    """The Gaussian, exp(steepness d^2), of what one vote falls short of the most: d is 0 at the least."""
    missing = most - votes
    # Not max(): what is no number is to stay none.
    short = _NONE if missing < _NONE else missing
    return exponential(steepness * short * short)


@vector_kernel
def likelihoods(votes: Float32, best: float, tolerance: float, sharpness: float, floor: float) -> Float32:
    """Likelihood of poses that were given so many votes, relative to the best: Gaussian in what they fall short of it.

    Parameters
    ----------
    votes : float32 (n,)
    best : float
        The most votes of all poses; more than these are no better.
    tolerance : float
        Standard deviation, votes.
    sharpness : float
        Power that the Gaussian is taken to.
    floor : float
        What is left of it where votes are few; 0 to 1.

    Returns
    -------
    float32 (n,)
        Floor to 1.
    """
    out = votes.copy()
    to_likelihoods(out, best, tolerance, sharpness, floor)
    return out


@vector_kernel
def to_likelihoods(votes: Float32, best: float, tolerance: float, sharpness: float, floor: float) -> None:
    """The same in the place of the votes."""
    steepness, least = np.float32(-0.5 * sharpness / (tolerance * tolerance)), np.float32(floor)
    most, rest = np.float32(best), np.float32(1.0 - floor)
    for i in range(votes.shape[0]):
        votes[i] = least + rest * fallen(votes[i], most, steepness)


@vector_kernel
def sums_of_likelihoods(votes: Float32, every: int, best: float, tolerance: float, sharpness: float) -> Float64:
    """Sums over every so many-th row of the likelihoods of votes (h, c), without a floor (see `likelihoods`); float64 (c,)."""
    steepness, most = np.float32(-0.5 * sharpness / (tolerance * tolerance)), np.float32(best)
    # Of at most some hundred headings: single precision is enough for these, and twice as many are added at once.
    sums = np.zeros(votes.shape[1], dtype=np.float32)
    for number in range(0, votes.shape[0], every):
        row = votes[number]
        for i in range(sums.shape[0]):
            sums[i] += fallen(row[i], most, steepness)
    return sums.astype(np.float64)


@vector_kernel
def weigh(weights: Float32, fit: Float32, slope: float, level: float) -> None:
    """Multiply weights (n,) by ``slope * fit + level``, in place."""
    steep, flat = np.float32(slope), np.float32(level)
    for i in range(weights.shape[0]):
        weights[i] = weights[i] * (steep * fit[i] + flat)


@vector_kernel
def scale(weights: Float32, factor: float) -> None:
    """Multiply weights (n,) by a factor, in place; none becomes less than the least normal number, so that none is lost for good."""
    by = np.float32(factor)
    for i in range(weights.shape[0]):
        scaled = weights[i] * by
        weights[i] = _LEAST if scaled < _LEAST else scaled


@kernel
def normal_density(poses: Float64, mean: Float64, whitening: Float64, scale: float) -> Float64:
    """Density of a normal distribution of poses; headings by the shorter way round.

    Parameters
    ----------
    poses : float64 (n, 3)
    mean : float64 (3,)
    whitening : float64 (3, 3)
        Lower triangle: the inverse of the Cholesky factor of the covariance.
    scale : float
        Logarithm of the density at the mean.

    Returns
    -------
    float64 (n,)
    """
    out = np.empty(poses.shape[0])
    turn = 2.0 * np.pi
    for i in range(poses.shape[0]):
        x, y, heading = poses[i, 0] - mean[0], poses[i, 1] - mean[1], poses[i, 2] - mean[2]
        heading -= turn * np.floor(heading / turn + 0.5)
        a, b = whitening[0, 0] * x, whitening[1, 0] * x + whitening[1, 1] * y
        c = whitening[2, 0] * x + whitening[2, 1] * y + whitening[2, 2] * heading
        out[i] = np.exp(scale - 0.5 * (a * a + b * b + c * c))
    return out

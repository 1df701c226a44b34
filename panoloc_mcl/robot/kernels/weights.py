"""From votes to likelihoods, and from likelihoods to weights and back: one pass over the particles each, several at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import exponential, logarithm
from panoloc_mcl.robot.kernels.jit import vector_kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

_TINY = float(np.finfo(np.float64).tiny)


@vector_kernel
def likelihoods(votes: Float32, best: float, tolerance: float, sharpness: float, floor: float) -> Float64:
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
    float64 (n,)
        Floor to 1.
    """
    out = np.empty(votes.shape[0])
    steepness, rest = -0.5 * sharpness / (tolerance * tolerance), 1.0 - floor
    for i in range(votes.shape[0]):
        missing = best - np.float64(votes[i])
        # Not max(): what is no number is to stay none.
        short = 0.0 if missing < 0.0 else missing
        out[i] = floor + rest * exponential(steepness * short * short)
    return out


@vector_kernel
def reweighted(log_weights: Float64, values: Float64, shift: float) -> Float64:
    """``log_weights + log(values) - shift``, float64 (n,).

    Parameters
    ----------
    log_weights, values : float64 (n,)
        Values of 0 count as the least positive float64, so that logarithms stay finite. NaN stays NaN.
    shift : float
    """
    out = np.empty(values.shape[0])
    for i in range(values.shape[0]):
        value = values[i]
        grown = log_weights[i] + (logarithm(_TINY if value < _TINY else value) - shift)
        out[i] = grown if value == value else np.nan
    return out


@vector_kernel
def exponentials(log_weights: Float64) -> Float64:
    """``exp(log_weights)``, float64 (n,), for values of 0 and less, minus infinity included."""
    out = np.empty(log_weights.shape[0])
    for i in range(log_weights.shape[0]):
        out[i] = exponential(log_weights[i])
    return out

"""Weights from log-weights, which particles go on, and how many (pure functions of arrays)."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.blocks import BLOCK
from panoloc_mcl.robot.kernels import resampling as kernels
from panoloc_mcl.robot.kernels.weights import exponentials
from panoloc_mcl.robot.settings.localizer import AdaptiveSettings

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

#: By the name of the scheme: (weights, count, rng) to ``count`` indices in rising order.
SCHEMES: dict[str, Callable[[Float64, int, np.random.Generator], Int64]] = {
    "systematic": lambda weights, count, rng: kernels.systematic(weights, rng.random(), count),
    "stratified": lambda weights, count, rng: kernels.stratified(weights, rng.random(count)),
    "residual": lambda weights, count, rng: kernels.residual(weights, rng.random(count)),
    "multinomial": lambda weights, count, rng: kernels.multinomial(weights, rng.random(count)),
}


def normalised(log_weights: Float64) -> Float64:
    """Weights that sum to 1, float64 (n,). Where no particle has any weight at all, all are equal."""
    weights = log_weights.copy()
    normalise(weights, weights)
    return weights


def normalise(log_weights: Float64, weights: Float64) -> None:
    """The same in place: log-weights are shifted so that the greatest is 0, and ``weights`` is filled (it may be the same array)."""
    top = log_weights.max()
    if not math.isfinite(top):
        log_weights.fill(0.0)
        weights.fill(1.0 / len(weights))
        return
    for start in range(0, len(weights), BLOCK):
        block = slice(start, start + BLOCK)
        log_weights[block] -= top
        weights[block] = exponentials(log_weights[block])
    weights /= weights.sum()


def effective_count(weights: Float64) -> float:
    """N_eff = 1 / sum of the squares of weights that sum to 1: their number if all are equal, 1 if one has it all."""
    return min(float(1.0 / np.dot(weights, weights)), float(len(weights)))


def adaptive_count(bins: int, settings: AdaptiveSettings) -> int:
    """Particles that keep the error with the asked probability when they fill so many bins (Fox 2003, equation 7).

    Parameters
    ----------
    bins : int
        Bins of the belief that hold any particle.
    settings : AdaptiveSettings
    """
    if bins < 2:
        return settings.min_particles
    # The quantile of chi-square with bins - 1 degrees of freedom, by Wilson and Hilferty.
    free = bins - 1
    spread = 2.0 / (9.0 * free)
    root = 1.0 - spread + math.sqrt(spread) * NormalDist().inv_cdf(settings.quantile)
    wanted = math.ceil(free / (2.0 * settings.error) * root**3)
    return min(max(wanted, settings.min_particles), settings.max_particles)

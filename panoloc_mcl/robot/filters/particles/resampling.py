"""Weights that sum to 1, which particles go on, and how many (functions of arrays)."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.filtering import resampling as kernels
from panoloc_mcl.robot.kernels.filtering.weights import scale
from panoloc_mcl.robot.settings.localizer import AdaptiveSettings

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

#: By the name of the scheme: (weights, count, rng) to ``count`` indices in rising order.
SCHEMES: dict[str, Callable[[Float32, int, np.random.Generator], Int64]] = {
    "systematic": lambda weights, count, rng: kernels.systematic(weights, rng.random(), count),
    "stratified": lambda weights, count, rng: kernels.stratified(weights, rng.random(count)),
    "residual": lambda weights, count, rng: kernels.residual(weights, rng.random(count)),
    "multinomial": lambda weights, count, rng: kernels.multinomial(weights, rng.random(count)),
}


def normalise(weights: Float32) -> None:
    """Make weights sum to 1, in place. Where no particle has any weight at all, all become equal."""
    total = float(weights.sum())
    if total > 0.0 and math.isfinite(total):
        scale(weights, 1.0 / total)
    else:
        weights.fill(1.0 / len(weights))


def effective_count(weights: Float32) -> float:
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

"""Confidence interval of a rate."""

from __future__ import annotations

import math

# 97.5 % quantile of the normal distribution.
Z_95 = 1.959963984540054


def wilson95(successes: int, trials: int) -> tuple[float, float] | None:
    """Wilson score interval of a rate at 95 %.

    Parameters
    ----------
    successes, trials : int
        ``0 <= successes <= trials``.

    Returns
    -------
    (low, high) : tuple of float, or None
        Within [0, 1] and around the rate; None for no trials.

    Raises
    ------
    ValueError
        Counts that are no counts.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials: give 0 <= successes <= trials")
    if trials == 0:
        return None
    rate = successes / trials
    z2 = Z_95 * Z_95
    centre = rate + z2 / (2 * trials)
    half = Z_95 * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials * trials))
    scale = 1 + z2 / trials
    # The ends are exactly 0 and 1 there; rounding must not move them past the rate.
    low = 0.0 if successes == 0 else min((centre - half) / scale, rate)
    high = 1.0 if successes == trials else max((centre + half) / scale, rate)
    return low, high

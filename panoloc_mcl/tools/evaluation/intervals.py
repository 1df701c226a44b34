"""Confidence intervals of rates. A drive is what is drawn at random: more seeds over the same images are no new trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

# Below this many drives a bootstrap over drives knows too few of them; set by its definition, tuned on nothing.
_FEW_DRIVES = 5
_RESAMPLES = 2_000


def wilson95(successes: int, trials: int) -> tuple[float, float] | None:
    """Wilson score interval of a rate at 95 %, by SciPy.

    Parameters
    ----------
    successes, trials : int
        ``0 <= successes <= trials``; the trials are independent.

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
    # Slow to import.
    from scipy.stats import binomtest

    found = binomtest(int(successes), int(trials)).proportion_ci(0.95, method="wilson")
    rate = successes / trials
    # Rounding must not move the ends past the rate.
    return min(max(float(found.low), 0.0), rate), max(min(float(found.high), 1.0), rate)


def interval95_over_drives(hits: Sequence[int], trials: Sequence[int]) -> tuple[float, float] | None:
    """95 % interval of a rate whose trials come from drives: images, runs with several seeds, or kidnaps of one drive are alike.

    Parameters
    ----------
    hits, trials : sequence of int, length n
        One entry a drive, summed over its seeds.

    Returns
    -------
    (low, high) : tuple of float, or None
        Wilson's, each drive one trial, where every drive is all or nothing. Else by bootstrap over drives (SciPy, percentiles), or,
        where there are fewer than 5 or all have the same rate, which resampling cannot see beyond, from Wilson's low end of the next
        lower number of whole drives to the high end of the next higher. None without trials.
    """
    known = [(hit, trial) for hit, trial in zip(hits, trials, strict=True) if trial]
    if not known:
        return None
    mine, of = (np.array(column, dtype=np.float64) for column in zip(*known, strict=True))
    shares = mine / of
    if len(known) < _FEW_DRIVES or np.ptp(shares) == 0.0 or set(shares.tolist()) <= {0.0, 1.0}:
        rate = float(mine.sum() / of.sum())
        least, most = (
            wilson95(int(drives), len(known)) or (0.0, 1.0) for drives in (np.floor(shares.sum()), np.ceil(shares.sum()))
        )
        return min(least[0], rate), max(most[1], rate)
    from scipy.stats import bootstrap

    found = bootstrap(
        (mine, of),
        lambda hit, trial, axis: hit.sum(axis=axis) / trial.sum(axis=axis),
        paired=True,
        vectorized=True,
        n_resamples=_RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(found.low), float(found.high)


def bootstrap95(values: ArrayLike, seed: int = 0) -> tuple[float, float]:
    """95 % interval of the mean by bootstrap (SciPy, percentiles).

    Parameters
    ----------
    values : array_like of float (n,)
        One a drive, n >= 1.
    seed : int
    """
    from scipy.stats import bootstrap

    sample = np.asarray(values, dtype=np.float64)
    if len(sample) < 2:
        # One drive tells nothing of others.
        return -np.inf, np.inf
    found = bootstrap((sample,), np.mean, n_resamples=10_000, method="percentile", rng=np.random.default_rng(seed))
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def quantile95_over_drives(values: ArrayLike, drives: ArrayLike, share: float = 0.5) -> tuple[float, float] | None:
    """95 % interval of a quantile of all images: by bootstrap over drives (percentiles), whose images are drawn together.

    Parameters
    ----------
    values : array_like of float (n,)
        One an image, may be infinite.
    drives : array_like (n,)
        The drive of each one.
    share : float
        Of the quantile.

    Returns
    -------
    (low, high) : tuple of float, or None
        None for fewer than 5 drives, which tell nothing of how drives differ.
    """
    of = np.asarray(values, dtype=np.float64)
    names, drive = np.unique(np.asarray(drives), return_inverse=True)
    if len(names) < _FEW_DRIVES:
        return None
    parts = [of[drive == index] for index in range(len(names))]
    # SciPy's bootstrap draws single values, not groups of them.
    drawn = np.random.default_rng(0).integers(0, len(parts), (_RESAMPLES, len(parts)))
    found = np.sort(
        [np.quantile(np.concatenate([parts[index] for index in row]), share, method="inverted_cdf") for row in drawn]
    )
    return float(found[int(0.025 * _RESAMPLES)]), float(found[int(0.975 * _RESAMPLES)])

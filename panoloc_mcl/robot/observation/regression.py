"""Logistic regression on a few figures: how probable it is that something is right (Platt 1999), and how good that is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

# Weights stay small where a few images say little.
_RIDGE = 0.003
_BINS = 10
_FEWEST_TEACHERS = 4


def probabilities(evidence: Float64, weights: Float64) -> Float64:
    """Of evidence (n, k), by weights (m, 1 + k) against m ways to be wrong, which exclude each other: float64 (n,)."""
    odds_against = np.exp(np.minimum(-(weights[:, 0] + evidence @ weights[:, 1:].T), 500.0))
    return np.asarray(1.0 / (1.0 + odds_against.sum(axis=1)))


def fitted(evidence: Float64, right: Bool, wrong_share: float | None = None, never_against: bool = False) -> Float64:
    """Weights of a logistic regression with a little ridge, in units of the evidence's own spread: float64 (1 + k,).

    Parameters
    ----------
    evidence : float64 (n, k)
        Each figure speaks for being right, the more the larger it is.
    right : bool (n,)
    wrong_share : float, optional
        Trials count so that those that are wrong make up this share; all alike if left out.
    never_against : bool
        Only the constant may be negative: more evidence never makes anything less sure.
    """
    mean, spread = evidence.mean(axis=0), np.maximum(evidence.std(axis=0), 1e-9)
    scaled = (evidence - mean) / spread
    signs = np.where(right, 1.0, -1.0)
    counts = np.full(len(right), 1.0 / len(right))
    if wrong_share is not None and right.any() and not right.all():
        counts = np.where(right, (1.0 - wrong_share) / right.sum(), wrong_share / (~right).sum())

    def loss(weights: Float64) -> tuple[float, Float64]:
        reached = signs * (weights[0] + scaled @ weights[1:])
        pull = -counts * signs * 0.5 * (1.0 - np.tanh(0.5 * reached))
        gradient = np.concatenate([[pull.sum()], pull @ scaled + 2.0 * _RIDGE * weights[1:]])
        # The constant, too: where all images were right, it would grow for ever.
        gradient[0] += 2.0 * 1e-3 * weights[0]
        ridge = _RIDGE * weights[1:] @ weights[1:] + 1e-3 * weights[0] ** 2
        return float(counts @ np.logaddexp(0.0, -reached) + ridge), gradient

    # Here, since a robot that runs does not need it.
    from scipy.optimize import minimize

    bounds = [(None, None), *[(0.0 if never_against else None, None)] * evidence.shape[1]]
    found = minimize(loss, np.zeros(evidence.shape[1] + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = found[1:] / spread
    return np.concatenate([[found[0] - weights @ mean], weights])


def fitted_apart(evidence: Float64, right: Bool, first: Bool, wrong_share: float) -> Float64:
    """Weights against two ways to be wrong, float64 (2, 1 + k): that of the ``first`` (n,), and that of the others.

    The others are right in part, so that little tells them from what is right but how far they agree. Where few references are held out
    that stand far apart, a robot's images agree more than any that was learnt from: evidence never counts against them.
    """
    others = ~first | right
    return np.array(
        [
            fitted(evidence[first], right[first], wrong_share),
            fitted(evidence[others], right[others], wrong_share, never_against=True),
        ]
    )


def out_of_fold(evidence: Float64, right: Bool, first: Bool, positions: Float64, gap: float, wrong_share: float) -> Float64:
    """Probabilities (n,) from weights that were learnt on the other side of the map, and not from neighbours of what is judged.

    Parameters
    ----------
    evidence, right, first : float64 (n, k), bool (n,) and bool (n,)
        As in `fitted_apart`; where all are the first, there is one way to be wrong.
    positions : float64 (n, 2)
        Metres.
    gap : float
        So near to what is judged nothing teaches, metres.
    wrong_share : float
        As in `fitted`.
    """
    axis = int(np.argmax(np.ptp(positions, axis=0)))
    side = positions[:, axis] > np.median(positions[:, axis])
    if side.all() or not side.any():
        # All in one line across: every second one.
        side = np.arange(len(right)) % 2 == 0
    found = np.empty(len(right))
    for judged in (side, ~side):
        apart = cKDTree(positions[judged]).query(positions)[0]
        teachers = ~judged & (apart > gap)
        if len(np.unique(positions[teachers], axis=0)) < _FEWEST_TEACHERS:
            teachers = ~judged
        taught = evidence[teachers], right[teachers]
        weights = fitted(*taught, wrong_share)[None] if first.all() else fitted_apart(*taught, first[teachers], wrong_share)
        found[judged] = probabilities(evidence[judged], weights)
    return found


def log_loss(probabilities: Float64, right: Bool) -> float:
    """Mean negative logarithm of the probability (n,) given to what was the case, nats."""
    given = np.where(right, probabilities, 1.0 - probabilities)
    return float(-np.log(np.maximum(given, 1e-12)).mean())


def expected_calibration_error(probabilities: Float64, right: Bool) -> float:
    """Mean distance between what was said and what was the case, over ten bins of probability (n,) (Guo et al. 2017)."""
    bins = np.minimum((probabilities * _BINS).astype(np.int64), _BINS - 1)
    said = np.bincount(bins, probabilities, _BINS)
    was = np.bincount(bins, right.astype(np.float64), _BINS)
    return float(np.abs(said - was).sum() / len(right))

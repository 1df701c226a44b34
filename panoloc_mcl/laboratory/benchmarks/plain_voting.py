"""The paper's voting in plain NumPy: what the kernel is timed against, and held to by the tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def vote_batched(
    responses: Array,
    rows: Array,
    columns: Array,
    design: Array,
    mean_responses: Array,
    references: Array,
    shifts: Array,
    keep: float,
    trim_to: int,
    width: float,
    *,
    downdate: bool = False,
    grams: Array | None = None,
) -> Array:
    """Votes (headings, places) without a loop over hypotheses or headings: batched linear algebra, in the precision of what is given.

    The arguments are those of ``kernels.voting.vote``.

    Every step solves the normal equations of the pixels that are left, summed anew, or with ``downdate`` those of the pixels left
    out subtracted. ``grams`` (m, p, p): normal matrices over all pixels, when they are known beforehand.
    """
    m, n, t, p = design.shape
    count, target = n, max(trim_to, -(-p // t))
    observed = observe(responses, rows, columns, mean_responses, shifts)
    equations = design.reshape(m, n * t, p)
    if grams is None:
        grams = np.swapaxes(equations, 1, 2) @ equations
    right = observed.reshape(m, -1, n * t) @ equations
    a = np.swapaxes(np.linalg.solve(grams, np.swapaxes(right, 1, 2)), 1, 2)
    grams = np.repeat(grams[:, None], len(shifts), axis=1)
    gone = np.zeros(observed.shape[:3], dtype=bool)
    hypothesis, heading = np.arange(m)[:, None, None], np.arange(len(shifts))[None, :, None]
    while count > target:
        survivors = max(target, int(count * keep))
        errors = observed.reshape(m, -1, n * t) - a @ np.swapaxes(equations, 1, 2)
        errors = (errors * errors).reshape(m, -1, n, t).sum(axis=3)
        errors[gone] = np.inf
        order = np.argpartition(errors, survivors - 1, axis=2)
        now_gone = np.ones_like(gone)
        np.put_along_axis(now_gone, order[:, :, :survivors], False, axis=2)
        chosen = np.nonzero(now_gone & ~gone if downdate else ~now_gone)[2].reshape(m, len(shifts), -1)
        taken = np.empty((*chosen.shape, t, p + 1), dtype=design.dtype)
        taken[..., :p] = design[hypothesis, chosen]
        taken[..., p] = observed[hypothesis, heading, chosen]
        taken = taken.reshape(m, len(shifts), -1, p + 1)
        products = np.swapaxes(taken, 2, 3) @ taken
        if downdate:
            grams -= products[..., :p, :p]
            right -= products[..., p, :p]
        else:
            grams, right = products[..., :p, :p], products[..., p, :p]
        a = np.linalg.solve(grams, right[..., None])[..., 0]
        gone, count = now_gone, survivors
    cosines = a @ references.T / np.linalg.norm(a, axis=2, keepdims=True)
    best = cosines.argmax(axis=2)
    angles = np.arccos(np.clip(cosines.max(axis=2), -1.0, 1.0))
    votes = np.zeros((len(shifts), len(references)))
    np.add.at(votes, (np.broadcast_to(heading[..., 0], best.shape), best), np.exp(-(angles**2) / (2.0 * width**2)) / m)
    return votes


def observe(responses: Array, rows: Array, columns: Array, mean_responses: Array, shifts: Array) -> Array:
    """Responses of the image turned back by all shifts at all pixels, mean removed: (m, s, n, t)."""
    whole = np.floor(shifts).astype(int)
    fraction = (shifts - whole).astype(mean_responses.dtype)[None, :, None]
    left = (columns[:, None, :] + whole[None, :, None]) % responses.shape[2]
    right = (left + 1) % responses.shape[2]
    rows = rows[:, None, :]
    read = [(1 - fraction) * plane[rows, left] + fraction * plane[rows, right] for plane in responses]
    return np.stack(read, axis=-1) - mean_responses[:, None]

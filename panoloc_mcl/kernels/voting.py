"""The paper's voting: trimmed least squares over fixed random pixel subsets, nearest neighbour by angle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.kernels.jit import kernel

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]


@kernel
def solve_positive(gram: Float64, right: Float64) -> Float64:
    """Solve ``gram a = right`` for a symmetric positive semi-definite matrix by Cholesky.

    Directions without support (pivot below 1e-12 of the largest diagonal entry) get the coefficient 0.

    Parameters
    ----------
    gram : float64 (p, p)
    right : float64 (p,)

    Returns
    -------
    float64 (p,)
    """
    p = gram.shape[0]
    factor = np.zeros((p, p))
    dead = np.zeros(p, dtype=np.bool_)
    scale = 0.0
    for j in range(p):
        scale = max(scale, gram[j, j])
    for j in range(p):
        pivot = gram[j, j]
        for k in range(j):
            pivot -= factor[j, k] * factor[j, k]
        if pivot <= 1e-12 * scale:
            dead[j] = True
            continue
        factor[j, j] = np.sqrt(pivot)
        for i in range(j + 1, p):
            value = gram[i, j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = value / factor[j, j]
    solution = np.zeros(p)
    for j in range(p):
        if dead[j]:
            continue
        value = right[j]
        for k in range(j):
            value -= factor[j, k] * solution[k]
        solution[j] = value / factor[j, j]
    for j in range(p - 1, -1, -1):
        if dead[j]:
            solution[j] = 0.0
            continue
        value = solution[j]
        for k in range(j + 1, p):
            value -= factor[k, j] * solution[k]
        solution[j] = value / factor[j, j]
    return solution


@kernel
def trimmed_coefficients(design: Float64, gram: Float64, observed: Float64, keep: float, trim_to: int) -> Float64:
    """Coefficients of one hypothesis by least squares with trimming of whole pixels (Leonardis & Bischof 2000).

    Solve, keep the pixels with the smallest residuals, and repeat down to ``trim_to`` pixels. Dropped pixels are subtracted from
    the normal equations, which is cheaper than building them again.

    Parameters
    ----------
    design : float64 (n, t, p)
        Responses of t filters on p eigenimages at n pixels.
    gram : float64 (p, p)
        Sum of the outer products of all n t rows of ``design``.
    observed : float64 (n, t)
        The same filters' responses on the image, mean removed.
    keep : float
        Share of the pixels that survives a step, in (0, 1).
    trim_to : int
        Pixels left at the end (at least p).

    Returns
    -------
    float64 (p,)
    """
    n, t, p = design.shape
    normal = gram.copy()
    right = np.zeros(p)
    for i in range(n):
        for f in range(t):
            for j in range(p):
                right[j] += design[i, f, j] * observed[i, f]
    kept = np.arange(n)
    count = n
    coefficients = solve_positive(normal, right)
    residuals = np.empty(n)
    target = max(trim_to, (p + t - 1) // t)
    while count > target:
        for a in range(count):
            i = kept[a]
            total = 0.0
            for f in range(t):
                error = observed[i, f]
                for j in range(p):
                    error -= design[i, f, j] * coefficients[j]
                total += error * error
            residuals[a] = total
        survivors = max(target, int(count * keep))
        limit = np.partition(residuals[:count], survivors - 1)[survivors - 1]
        # Pixels at the limit itself fill up the survivors in their order, so the count is exact with ties, too.
        below = 0
        for a in range(count):
            if residuals[a] < limit:
                below += 1
        ties = survivors - below
        left = 0
        for a in range(count):
            i = kept[a]
            stays = residuals[a] < limit
            if not stays and residuals[a] == limit and ties > 0:
                stays = True
                ties -= 1
            if stays:
                kept[left] = i
                left += 1
                continue
            for f in range(t):
                for j in range(p):
                    value = design[i, f, j]
                    right[j] -= value * observed[i, f]
                    for k in range(j + 1):
                        normal[j, k] -= value * design[i, f, k]
        if left == count:
            break
        count = left
        for j in range(p):
            for k in range(j):
                normal[k, j] = normal[j, k]
        coefficients = solve_positive(normal, right)
    return coefficients


@kernel
def vote(
    responses: Float32,
    rows: Int32,
    columns: Int32,
    design: Float64,
    grams: Float64,
    mean_responses: Float64,
    references: Float64,
    shifts: Float64,
    keep: float,
    trim_to: int,
    width: float,
) -> Float64:
    """Votes of all hypotheses for all references, for an image turned back by each of several headings.

    Parameters
    ----------
    responses : float32 (t, rows, columns)
        Filter responses of the image, which is never turned: a heading is a column offset.
    rows, columns : int32 (m, n)
        The n pixels of each of m hypotheses.
    design : float64 (m, n, t, p)
    grams : float64 (m, p, p)
    mean_responses : float64 (m, n, t)
        Filter responses of the mean image at those pixels.
    references : float64 (k, p)
        Coefficients of the references, scaled to unit length.
    shifts : float64 (s,)
        Column offsets, one a heading; read linearly between columns.
    keep, trim_to
        See `trimmed_coefficients`.
    width : float
        Sigma of the voting function, radians.

    Returns
    -------
    float64 (s, k)
        Sum over the hypotheses of exp(-d^2 / (2 width^2)), given to the nearest reference by angle alone (eqs. 3 and 4), divided
        by the number of hypotheses.
    """
    m, n = rows.shape
    t = responses.shape[0]
    width_px = responses.shape[2]
    p = references.shape[1]
    votes = np.zeros((shifts.shape[0], references.shape[0]))
    observed = np.empty((n, t))
    for s in range(shifts.shape[0]):
        base = np.floor(shifts[s])
        fraction = shifts[s] - base
        for h in range(m):
            for i in range(n):
                left = (columns[h, i] + int(base)) % width_px
                right = (left + 1) % width_px
                for f in range(t):
                    value = (1.0 - fraction) * responses[f, rows[h, i], left] + fraction * responses[f, rows[h, i], right]
                    observed[i, f] = value - mean_responses[h, i, f]
            a = trimmed_coefficients(design[h], grams[h], observed, keep, trim_to)
            norm = 0.0
            for j in range(p):
                norm += a[j] * a[j]
            if norm == 0.0:
                continue
            norm = np.sqrt(norm)
            best = -1
            best_cosine = -2.0
            for k in range(references.shape[0]):
                cosine = 0.0
                for j in range(p):
                    cosine += references[k, j] * a[j]
                cosine /= norm
                if cosine > best_cosine:
                    best_cosine = cosine
                    best = k
            angle = np.arccos(min(1.0, best_cosine))
            votes[s, best] += np.exp(-angle * angle / (2.0 * width * width)) / m
    return votes

"""Which particles go on: four schemes of drawing in proportion to weights, all unbiased (Douc, Cappe & Moulines 2005).

All give the indices in rising order. Sums are kept in float64, and the last target always meets the last particle with any weight,
whatever rounding did on the way.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel

# float32 as the program calls it; residual resampling picks in float64, and the tests do.
Real = NDArray[Any]
Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Weights that are summed up together.
_BLOCK = 512


@kernel
def systematic(weights: Real, offset: float, count: int) -> Int64:
    """Systematic resampling (Kitagawa 1996): one random number; index i comes floor or ceil of ``count * weight_i / sum`` times.

    Parameters
    ----------
    weights : float32 or float64 (n,)
        Non-negative, sum > 0; need not be normalised.
    offset : float
        Uniform in [0, 1).
    count : int
        How many indices to draw.

    Returns
    -------
    int64 (count,)
    """
    last = weights.shape[0] - 1
    while last > 0 and weights[last] == 0.0:
        last -= 1
    sums, total = np.empty(_BLOCK), 0.0
    for start in range(0, last + 1, _BLOCK):
        total = running_sums(weights[start : start + _BLOCK], total, sums)
    per_weight, most = count / total, np.float64(count)
    # How many particles begin at each target. Counted and summed up, so that no branch is needed, which the processor would guess
    # wrong for every other particle.
    indices = np.zeros(count + 1, dtype=np.int64)
    begins = np.zeros(_BLOCK, dtype=np.int32)
    # The first begins at the first target; the last one ends at the last, whatever rounding did.
    indices[0], sofar = 1, 0.0
    for start in range(0, last, _BLOCK):
        sofar = running_sums(weights[start : start + _BLOCK], sofar, sums)
        for i in range(_BLOCK):
            # How many targets (k + offset) / count lie below the share so far: there the next particle begins.
            begins[i] = np.int32(min(np.ceil(sums[i] * per_weight - offset), most))
        for i in range(min(_BLOCK, last - start)):
            indices[np.uint64(begins[i])] += 1
    newest = -1
    for k in range(count):
        newest += indices[k]
        indices[k] = newest
    return indices[:count]


@kernel
def running_sums(weights: Real, before: float, out: Float64) -> float:
    """Cumulative sums of at most a block of weights, and of what came ``before``, into float64 (512,); returns the last.

    Of four parts at once, whose sums need not wait for each other; after the last weight sums stay as they are.
    """
    count, part = weights.shape[0], out.shape[0] // 4
    for i in range(count):
        out[i] = np.float64(weights[i])
    out[count:] = 0.0
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for i in range(part):
        a += out[i]
        b += out[part + i]
        c += out[2 * part + i]
        d += out[3 * part + i]
        out[i], out[part + i], out[2 * part + i], out[3 * part + i] = a, b, c, d
    for quarter in range(4):
        for i in range(part):
            out[quarter * part + i] += before
        before = out[quarter * part + part - 1]
    return before


@kernel
def stratified(weights: Real, uniforms: Float64) -> Int64:
    """Stratified resampling: a random number for each of the equal parts of the sum; a count is off its share by less than two.

    Parameters
    ----------
    weights : float32 (n,)
        As above.
    uniforms : float64 (count,)
        In [0, 1).

    Returns
    -------
    int64 (count,)
    """
    count = uniforms.shape[0]
    targets = np.empty(count)
    for k in range(count):
        targets[k] = (k + uniforms[k]) / count
    return pick(weights, targets)


@kernel
def multinomial(weights: Real, uniforms: Float64) -> Int64:
    """Multinomial resampling: every draw independent of the others; the noisiest.

    Parameters
    ----------
    weights : float32 (n,)
        As above.
    uniforms : float64 (count,)
        In [0, 1).

    Returns
    -------
    int64 (count,)
    """
    return pick(weights, np.sort(uniforms))


@kernel
def residual(weights: Real, uniforms: Float64) -> Int64:
    """Residual resampling (Liu & Chen 1998): the whole part of every share for certain, the rest multinomially.

    Parameters
    ----------
    weights : float32 (n,)
        As above.
    uniforms : float64 (count,)
        In [0, 1); as many are used as draws are left.

    Returns
    -------
    int64 (count,)
    """
    n, count = weights.shape[0], uniforms.shape[0]
    total = 0.0
    for i in range(n):
        total += np.float64(weights[i])
    copies = np.empty(n, dtype=np.int64)
    rest = np.empty(n)
    certain = 0
    for i in range(n):
        share = count * (np.float64(weights[i]) / total)
        copies[i] = int(share)
        rest[i] = share - copies[i]
        certain += copies[i]
    if certain < count:
        # Rounding may leave nothing of shares that are whole.
        left = rest if rest.sum() > 0.0 else weights.astype(np.float64)
        for i in pick(left, np.sort(uniforms[: count - certain])):
            copies[i] += 1
    indices = np.empty(count, dtype=np.int64)
    k = 0
    for i in range(n):
        for _ in range(min(copies[i], count - k)):
            indices[k] = i
            k += 1
    return indices


@kernel
def pick(weights: Real, targets: Float64) -> Int64:
    """Indices at which the cumulative weight first exceeds each target.

    Parameters
    ----------
    weights : float32 (n,)
        As above.
    targets : float64 (count,)
        Shares of the sum in [0, 1), rising.

    Returns
    -------
    int64 (count,)
    """
    total, last = 0.0, 0
    for i in range(weights.shape[0]):
        total += np.float64(weights[i])
        if weights[i] > 0.0:
            last = i
    indices = np.empty(targets.shape[0], dtype=np.int64)
    i = 0
    cumulative = np.float64(weights[0])
    for k in range(targets.shape[0]):
        target = targets[k] * total
        while cumulative <= target and i < last:
            i += 1
            cumulative += np.float64(weights[i])
        indices[k] = i
    return indices

"""The paper's voting: trimmed least squares over fixed random pixel subsets, nearest neighbour by angle.

What is fast here: all headings of a hypothesis go through one matrix product; the hypothesis' equations are *whitened* beforehand
(columns orthonormal over its pixels), so that the first solution is that product itself and single precision is enough; trimmed
pixels are subtracted from the normal equations, once more by a matrix product; and the limit of the residuals is found by counting,
without sorting. Loops that carry the time are small functions over contiguous arrays, which the compiler turns into vector code.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel
from panoloc_mcl.robot.kernels.selection import leave_out, limit_of_smallest, remaining

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
# float32 as the program calls it; the tests also run float64.
Real = NDArray[Any]
Int32 = NDArray[np.int32]
UInt32 = NDArray[np.uint32]

# Headings that go through one matrix product: more gain little, and their filter responses leave the cache.
_TOGETHER = 8


@kernel
def solve_positive(system: Real, tolerance: float) -> Real:
    """Solve ``gram a = right`` for a symmetric positive semi-definite matrix by Cholesky.

    Directions without support (pivot at or below the tolerance) get the coefficient 0.

    Parameters
    ----------
    system : float32 or float64 (p + 1, p + 1)
        The matrix, with the right side as last row; only the lower triangle is read.
    tolerance : float

    Returns
    -------
    same dtype (p,)
    """
    p = system.shape[0] - 1
    factor = system.copy()
    for j in range(p):
        pivot = factor[j, j]
        for k in range(j):
            pivot -= factor[j, k] * factor[j, k]
        if pivot <= tolerance:
            factor[j:, j] = 0
            continue
        inverse = 1 / np.sqrt(pivot)
        factor[j, j] = inverse
        # Four rows at once: each is a chain of dependent sums, and one would leave the processor waiting.
        i = j + 1
        while i + 4 <= p + 1:
            a, b, c, d = factor[i, j], factor[i + 1, j], factor[i + 2, j], factor[i + 3, j]
            for k in range(j):
                value = factor[j, k]
                a -= factor[i, k] * value
                b -= factor[i + 1, k] * value
                c -= factor[i + 2, k] * value
                d -= factor[i + 3, k] * value
            factor[i, j], factor[i + 1, j] = a * inverse, b * inverse
            factor[i + 2, j], factor[i + 3, j] = c * inverse, d * inverse
            i += 4
        while i < p + 1:
            a = factor[i, j]
            for k in range(j):
                a -= factor[i, k] * factor[j, k]
            factor[i, j] = a * inverse
            i += 1
    # The diagonal holds inverses, and the last row the right side, already solved forward.
    solution: Real = factor[p, :p].copy()
    for j in range(p - 1, -1, -1):
        value = solution[j]
        for k in range(j + 1, p):
            value -= factor[k, j] * solution[k]
        solution[j] = value * factor[j, j]
    return solution


@kernel
def take_rows(by_pixel: Real, observed: Real, chosen: Int32, out: Real) -> Real:
    """Equations of some pixels, with what was observed in their last column.

    Parameters
    ----------
    by_pixel : float32 or float64 (n, t q)
        The t equations of q numbers of every pixel.
    observed : same dtype (t n,)
        Filter by filter.
    chosen : int32 (k,)
    out : same dtype (k, t q)

    Returns
    -------
    same dtype (k, t q)
        ``out``.
    """
    n, width = by_pixel.shape
    t = observed.shape[0] // n
    q = width // t
    for c in range(chosen.shape[0]):
        pixel = chosen[c]
        for j in range(width):
            out[c, j] = by_pixel[pixel, j]
    for f in range(t):
        for c in range(chosen.shape[0]):
            out[c, f * q + q - 1] = observed[f * n + chosen[c]]
    return out


@kernel
def add_squares(observed: Real, fitted: Real, residuals: Float32) -> Float32:
    """Add squared differences to float32 (n,) residuals and return them."""
    for i in range(residuals.shape[0]):
        error = observed[i] - fitted[i]
        residuals[i] += error * error
    return residuals


@kernel
def add(target: Real, values: Real, sign: int) -> Real:
    """Add a matrix to another one, or with ``sign`` -1 subtract it; return that."""
    for j in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[j, k] += sign * values[j, k]
    return target


@kernel
def trimmed_coefficients(transposed: Real, by_pixel: Real, observed: Real, keep: float, trim_to: int) -> Real:
    """Coefficients of one hypothesis by least squares with trimming of whole pixels (Leonardis & Bischof 2000).

    Solve, keep the pixels with the smallest residuals, and repeat down to ``trim_to`` pixels. Every heading trims its own pixels.

    Parameters
    ----------
    transposed : float32 or float64 (p + 1, t n)
        Whitened equations of t filters at n pixels, filter by filter: p rows orthonormal (or 0), the last one 0.
    by_pixel : same dtype (n, t (p + 1))
        The same, pixel by pixel, from where those of single pixels are copied.
    observed : same dtype (s, t n)
        The same filters' responses on the image at s headings, mean removed.
    keep : float
        Share of the pixels that survives a step, in (0, 1).
    trim_to : int
        Pixels left at the end (at least as many as p takes).

    Returns
    -------
    same dtype (s, p + 1)
        Coefficients of the whitened equations; the last one is 0.
    """
    headings = observed.shape[0]
    q = transposed.shape[0]
    p = q - 1
    pixels = by_pixel.shape[0]
    t = observed.shape[1] // pixels
    coefficients: Real = np.ascontiguousarray(np.dot(transposed, observed.T).T)
    target = max(trim_to, (p + t - 1) // t)
    if pixels <= target:
        return coefficients
    # Normal equations, right side as last row and column.
    systems = np.zeros((headings, q, q), dtype=observed.dtype)
    for s in range(headings):
        for j in range(p):
            systems[s, j, j] = 1
            systems[s, p, j] = coefficients[s, j]
    tolerance = 100 * np.finfo(observed.dtype).eps
    fitted = np.empty_like(observed)
    product = np.empty((q, q), dtype=observed.dtype)
    residuals = np.empty(pixels, dtype=np.float32)
    bits = residuals.view(np.int32)
    gone = np.zeros((headings, pixels), dtype=np.uint8)
    chosen = np.empty(pixels + 1, dtype=np.int32)
    most = max(pixels - max(target, int(pixels * keep)), pixels // 2) + 1
    taken = np.empty((most, t * q), dtype=observed.dtype)
    guess = 1 << 29
    count = pixels
    while count > target:
        survivors = max(target, int(count * keep))
        np.dot(coefficients, transposed, fitted)
        for s in range(headings):
            residuals[:] = 0
            for start in range(0, t * pixels, pixels):
                add_squares(observed[s, start : start + pixels], fitted[s, start : start + pixels], residuals)
            if count < pixels:
                for i in range(pixels):
                    if gone[s, i]:
                        residuals[i] = np.inf
            limit, ties = limit_of_smallest(bits, survivors, guess)
            guess = limit
            number = leave_out(bits, limit, ties, chosen)
            for c in range(number):
                gone[s, chosen[c]] = 1
            # Subtracting most of the pixels would leave little but rounding: few are summed anew.
            anew = 2 * survivors < pixels
            if anew:
                number = remaining(gone[s], chosen)
                systems[s] = 0
            rows = take_rows(by_pixel, observed[s], chosen[:number], taken[:number]).reshape(t * number, q)
            np.dot(rows.T, rows, product)
            add(systems[s], product, 1 if anew else -1)
            coefficients[s, :p] = solve_positive(systems[s], tolerance)
        count = survivors
    return coefficients


@kernel
def read(plane: Float32, places: UInt32, offset: np.uint32, fraction: np.float32, mean: Real, out: Real) -> Real:
    """Pixels of a turned image, linear between columns, minus those of the mean image.

    Parameters
    ----------
    plane : float32 (pixels,)
        One filter's responses.
    places : uint32 (n,)
        Indices of the pixels. Unsigned, because looking for negative indices would cost vector code.
    offset : uint32
        Columns to the right, and ``fraction`` of the way to the next one.
    mean : float32 or float64 (n,)
    out : same dtype (n,)

    Returns
    -------
    same dtype (n,)
        ``out``.
    """
    rest = np.float32(1) - fraction
    one = np.uint32(1)
    for i in range(places.shape[0]):
        left = places[i] + offset
        out[i] = rest * plane[left] + fraction * plane[left + one] - mean[i]
    return out


@kernel
def vote(
    responses: Float32,
    rows: Int32,
    columns: Int32,
    transposed: Real,
    by_pixel: Real,
    back: Real,
    mean_responses: Real,
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
        The n pixels of each of m hypotheses; rows in order read fastest.
    transposed, by_pixel : float32 or float64 (m, p + 1, t n), (m, n, t (p + 1))
        See `trimmed_coefficients`.
    back : same dtype (m, p + 1, p)
        Turns coefficients of the whitened equations into coefficients of the eigenimages.
    mean_responses : same dtype (m, t n)
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
    t, height, image_columns = responses.shape
    # Twice side by side, so that a turned image needs no modulo.
    padded = np.empty((t, height * 2 * image_columns), dtype=np.float32)
    for f in range(t):
        for r in range(height):
            start = 2 * image_columns * r
            padded[f, start : start + image_columns] = responses[f, r]
            padded[f, start + image_columns : start + 2 * image_columns] = responses[f, r]
    votes = np.zeros((shifts.shape[0], references.shape[0]))
    places = np.empty(n, dtype=np.uint32)
    observed_all = np.empty((_TOGETHER, t * n), dtype=transposed.dtype)
    for h in range(m):
        for i in range(n):
            places[i] = 2 * image_columns * rows[h, i] + columns[h, i]
        for first in range(0, shifts.shape[0], _TOGETHER):
            observed = observed_all[: min(_TOGETHER, shifts.shape[0] - first)]
            for s in range(observed.shape[0]):
                whole = np.floor(shifts[first + s])
                offset, fraction = np.uint32(int(whole) % image_columns), np.float32(shifts[first + s] - whole)
                for f in range(t):
                    start = f * n
                    read(
                        padded[f],
                        places,
                        offset,
                        fraction,
                        mean_responses[h, start : start + n],
                        observed[s, start : start + n],
                    )
            whitened = trimmed_coefficients(transposed[h], by_pixel[h], observed, keep, trim_to)
            # In double precision, or equal angles would not give equal votes.
            coefficients = np.dot(whitened, back[h]).astype(np.float64)
            products = np.dot(coefficients, references.T)
            for s in range(observed.shape[0]):
                squared = 0.0
                for j in range(coefficients.shape[1]):
                    squared += coefficients[s, j] * coefficients[s, j]
                if squared == 0.0:
                    continue
                best = 0
                for k in range(references.shape[0]):
                    if products[s, k] > products[s, best]:
                        best = k
                angle = np.arccos(min(1.0, products[s, best] / np.sqrt(squared)))
                votes[first + s, best] += np.exp(-angle * angle / (2.0 * width * width)) / m
    return votes

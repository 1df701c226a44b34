"""Gradients as they are, and local orientation: gradients divided by their own length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel, vector_kernel

Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
UInt8 = NDArray[np.uint8]


@vector_kernel
def normalised_gradients(grey: Float32, bad: UInt8, margin: int, floor: float, doubled: bool) -> Complex64:
    """Central differences of an image, normalised pixel by pixel.

    Parameters
    ----------
    grey : float32 (rows, columns + 2 margin)
        Smoothed grey levels, continued by ``margin`` >= 1 columns on both sides.
    bad : uint8, same shape
        Pixels whose result is 0.
    margin : int
    floor : float
        c, grey levels per pixel.
    doubled : bool
        z^2 / (|z|^2 + c^2) instead of z / (|z| + c).

    Returns
    -------
    complex64 (rows, columns)
        0 in the first and the last row, where there is no vertical difference.
    """
    rows, padded = grey.shape
    columns = padded - 2 * margin
    z = np.empty((rows, columns), dtype=np.complex64)
    z[0], z[-1] = 0.0, 0.0
    zero, one, half, two = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(2.0)
    c = np.float32(floor)
    for r in range(1, rows - 1):
        here, above, below, hidden, out = grey[r], grey[r - 1], grey[r + 1], bad[r], z[r]
        # A factor instead of a branch, so that the loops are vectorised.
        if doubled:
            for k in range(columns):
                p = k + margin
                gx, gy = half * (here[p + 1] - here[p - 1]), half * (below[p] - above[p])
                scale = (zero if hidden[p] else one) / (gx * gx + gy * gy + c * c)
                out[k] = complex((gx * gx - gy * gy) * scale, two * gx * gy * scale)
        else:
            for k in range(columns):
                p = k + margin
                gx, gy = half * (here[p + 1] - here[p - 1]), half * (below[p] - above[p])
                scale = (zero if hidden[p] else one) / (np.sqrt(gx * gx + gy * gy) + c)
                out[k] = complex(gx * scale, gy * scale)
    return z


@kernel
def plain_gradients(grey: Float32, bad: UInt8, margin: int) -> Complex64:
    """Central differences of an image as they are.

    Parameters
    ----------
    grey, bad, margin
        See `normalised_gradients`.

    Returns
    -------
    complex64 (rows, columns)
        Grey levels per pixel; 0 where bad, and in the first and the last row.
    """
    rows, padded = grey.shape
    columns = padded - 2 * margin
    z = np.zeros((rows, columns), dtype=np.complex64)
    half = np.float32(0.5)
    for r in range(1, rows - 1):
        for k in range(columns):
            p = k + margin
            if not bad[r, p]:
                z[r, k] = complex(half * (grey[r, p + 1] - grey[r, p - 1]), half * (grey[r + 1, p] - grey[r - 1, p]))
    return z

"""From the row spectra of an image to its correlations with eigenimages, and from correlations with places to votes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import exponential
from panoloc_mcl.robot.kernels.jit import vector_kernel

Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]

# Of arccos(1 - u)^2 = u P(u) on [0, 1], good to 4e-8, by iteratively reweighted least squares.
_SQUARED_ANGLE = (
    np.float32(1.999999158e0), np.float32(3.333782732e-1), np.float32(8.829296080e-2), np.float32(3.198727627e-2),
    np.float32(1.766584052e-5), np.float32(2.038092771e-2), np.float32(-1.287000059e-2), np.float32(6.214798568e-3),
)  # fmt: skip
_ZERO, _ONE, _TINY = np.float32(0.0), np.float32(1.0), np.finfo(np.float32).tiny


@vector_kernel
def spectra_product(real: Float32, imaginary: Float32, spectrum: Complex64) -> Complex64:
    """Product of the image's row spectra with those of the eigenimages, summed over the rows.

    Parameters
    ----------
    real, imaginary : float32 (frequencies, rows, p)
        Of the eigenimages' spectra. They are what is read from memory, once.
    spectrum : complex64 (frequencies, rows)
        Of the image.

    Returns
    -------
    complex64 (frequencies, p)
    """
    frequencies, rows, count = real.shape
    out = np.empty((frequencies, count), dtype=np.complex64)
    a, b = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    for k in range(frequencies):
        a[:] = _ZERO
        b[:] = _ZERO
        for r in range(rows):
            re, im, x, y = real[k, r], imaginary[k, r], spectrum[k, r].real, spectrum[k, r].imag
            for p in range(count):
                a[p] += x * re[p] - y * im[p]
                b[p] += x * im[p] + y * re[p]
        for p in range(count):
            out[k, p] = complex(a[p], b[p])
    return out


@vector_kernel
def to_votes(correlations: Float32, norms: Float32, width: float) -> None:
    """Turn correlations into votes, in their place: the paper's voting function (eq. 3) of the angle, 0 beyond a right angle.

    Parameters
    ----------
    correlations : float32 (headings, k)
    norms : float32 (blocks, k)
        Products of the norms, at as many equally spaced headings; linear in between, around the circle.
    width : float
        Sigma of the voting function, radians.
    """
    headings, places = correlations.shape
    blocks, steepness = norms.shape[0], np.float32(-0.5 / (width * width))
    for h in range(headings):
        position = h * (blocks / headings)
        lower = int(position)
        fraction, here = np.float32(position - lower), correlations[h]
        before, after = norms[lower % blocks], norms[(lower + 1) % blocks]
        for k in range(places):
            cosine = here[k] / max(before[k] + fraction * (after[k] - before[k]), _TINY)
            u = _ONE - min(max(cosine, _ZERO), _ONE)
            squared = _SQUARED_ANGLE[7]
            for i in range(6, -1, -1):
                squared = squared * u + _SQUARED_ANGLE[i]
            here[k] = exponential(steepness * u * squared)

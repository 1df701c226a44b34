"""Inner products of an image at all headings at once: turning is a shift of columns, so they are a product of row spectra."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]


def row_spectra(images: Float32 | Complex64) -> Complex64:
    """Conjugate row spectra of images (n, rows, columns), frequency first.

    Returns
    -------
    complex64 (f, n, rows)
        f = columns // 2 + 1 for real images, columns for complex ones.
    """
    return np.ascontiguousarray(np.moveaxis(_transform(images).conj(), -1, 0), dtype=np.complex64)


def turned_products(spectra: Complex64, image: Float32 | Complex64) -> Float32:
    """Real inner products of images with one that is turned back by every heading.

    Parameters
    ----------
    spectra : complex64 (f, n, rows)
        As `row_spectra` gives them.
    image : float32 or complex64 (rows, columns)
        Real where the images were real.

    Returns
    -------
    float32 (columns, n)
        Row i: the image turned back by i columns.
    """
    spectrum = np.ascontiguousarray(_transform(image).T)
    products = np.matmul(spectra, spectrum[:, :, None])[:, :, 0]
    if np.iscomplexobj(image):
        return np.ascontiguousarray(fft.ifft(products, axis=0).real, dtype=np.float32)
    return np.asarray(fft.irfft(products, n=image.shape[1], axis=0), dtype=np.float32)


def spread_over_headings(place_votes: Float32, profiles: Float32) -> Float32:
    """A field of places that are voted for without regard to the heading, which something else gives.

    Parameters
    ----------
    place_votes : float32 (k,)
    profiles : float32 (columns, k)
        How well each heading fits at each place; what is below 0 does not fit at all.

    Returns
    -------
    float32 (columns, k)
        Each place has its votes in full at its best heading; at a place where no heading fits, at all of them.
    """
    fitting = np.maximum(profiles, 0.0)
    best = fitting.max(axis=0)
    shares = np.where(best > 0.0, fitting / np.where(best > 0.0, best, 1.0), 1.0)
    return np.asarray(shares * place_votes, dtype=np.float32)


def _transform(images: NDArray[Any]) -> NDArray[Any]:
    """Spectra of the rows; the half spectrum of real images."""
    return np.asarray(fft.fft(images, axis=-1) if np.iscomplexobj(images) else fft.rfft(images, axis=-1))

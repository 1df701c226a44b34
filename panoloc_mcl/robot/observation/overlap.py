"""Norms of two images over the pixels that are usable in both, for all headings and places.

What is masked in one image cannot be matched in the other, so it must not count in the norm either. The energy that one image has
where the other is usable is a circular correlation again. Both vary slowly, so sums over blocks of pixels are enough.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# Pixels of a block: masks in use are columns (bars, people) rather than rows.
BLOCK_ROWS, BLOCK_COLUMNS = 12, 5


def squared_magnitude(z: Complex64) -> Float32:
    """|z|^2 of every pixel."""
    return np.asarray(z.real * z.real + z.imag * z.imag, dtype=np.float32)


def block_energy(z: Complex64) -> Float32:
    """Squared magnitude summed over blocks, float32 (block rows, block columns)."""
    return _sums(squared_magnitude(z))


def block_usable(usable: Bool) -> Float32:
    """Share of every block's pixels that is usable, float32 (block rows, block columns); the rim rows, never usable, do not count."""
    return np.asarray(_sums(usable.astype(np.float32)) / _countable(usable.shape), dtype=np.float32)


@lru_cache(maxsize=8)
def _countable(shape: tuple[int, ...]) -> Float32:
    """Pixels of every block that can be usable, at least 1."""
    countable = np.ones(shape, dtype=np.float32)
    countable[[0, -1]] = 0.0
    return np.maximum(_sums(countable), np.float32(1.0))


class OverlapNorms:
    """The places' side of the norms, ready for any image.

    Parameters
    ----------
    energy, usable : float32 (k, block rows, block columns)
        Of every place (see `block_energy`, `block_usable`).
    """

    def __init__(self, energy: Float32, usable: Float32) -> None:
        self.energy, self.usable = energy, usable
        self._blocks = energy.shape[2]

    @cached_property
    def _energy_spectra(self) -> Complex64:
        return _spectra(self.energy)

    @cached_property
    def _usable_spectra(self) -> Complex64:
        return _spectra(self.usable)

    @cached_property
    def _energy_total(self) -> Float32:
        return np.asarray(self.energy.sum(axis=(1, 2)))

    def of(self, z: Complex64, usable: Bool) -> Float32:
        """Product of the image's and the places' norms over the overlap, float32 (block columns, k).

        Entry (b, p) is for the image turned back by b blocks; in between it is linear.
        """
        energy = block_energy(z)
        mine = self._correlation(energy, self._usable_spectra)
        theirs = self._correlation(block_usable(usable), self._energy_spectra)
        # An overlap with less than a hundredth of the energy says nothing; it must not be blown up.
        np.maximum(mine, 0.01 * energy.sum(), out=mine)
        np.maximum(theirs, 0.01 * self._energy_total, out=theirs)
        mine *= theirs
        return np.sqrt(mine, out=mine)

    def _correlation(self, image: Float32, places: Complex64) -> Float32:
        spectrum = np.ascontiguousarray(fft.rfft(image, axis=1).T)
        product = np.matmul(places, spectrum[:, :, None])[:, :, 0]
        return np.asarray(fft.irfft(product, n=self._blocks, axis=0), dtype=np.float32)


def _spectra(blocks: Float32) -> Complex64:
    """Conjugate row spectra, frequency first: complex64 (frequencies, k, block rows)."""
    return np.ascontiguousarray(np.moveaxis(fft.rfft(blocks, axis=2).conj(), 2, 0), dtype=np.complex64)


def _sums(image: Float32) -> Float32:
    rows, columns = image.shape
    counts = (max(1, rows // BLOCK_ROWS), max(4, columns // BLOCK_COLUMNS))
    starts = [
        np.linspace(0, size, count, endpoint=False).astype(np.int64) for size, count in zip(image.shape, counts, strict=True)
    ]
    return np.asarray(np.add.reduceat(np.add.reduceat(image, starts[0], axis=0), starts[1], axis=1), dtype=np.float32)

"""An image against all places, at all headings: as votes, and at a glance.

Turning the robot shifts the columns of its panorama, so the projections of the image at *all* headings on an eigenimage are one
circular correlation along the rows: a product of spectra, summed over the rows, and one inverse FFT an eigenimage. Correlations with
places follow by one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.robot.kernels.correlations import spectra_product, to_votes
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.observation.overlap import OverlapNorms, squared_magnitude

Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# Of a glance: so many eigenimages, the first, which hold the most; and headings so many columns apart.
_GLANCE_COMPONENTS, _GLANCE_COLUMNS = 32, 5


@dataclass(frozen=True, eq=False)
class Correlator:
    """The map's side of the votes.

    Parameters
    ----------
    real, imaginary : float32 (frequencies, rows, p)
        Conjugate row spectra of the eigenimages, in the order that the kernel runs through them.
    coefficients : complex64 (k, p)
        Of the places.
    norms : OverlapNorms
        Of the places.
    columns : int
        Of a panorama: as many headings are voted on.
    bandwidth : float
        Share of the row frequencies that the spectra hold.
    """

    real: Float32
    imaginary: Float32
    coefficients: Complex64
    norms: OverlapNorms
    columns: int
    bandwidth: float

    @classmethod
    def of(
        cls, spectra: Complex64, coefficients: Complex64, energy: Float32, usable: Float32, columns: int, bandwidth: float
    ) -> Self:
        """Of conjugate row spectra as complex64 (frequencies, p, rows)."""
        real, imaginary = (np.ascontiguousarray(part.transpose(0, 2, 1)) for part in (spectra.real, spectra.imag))
        return cls(real, imaginary, coefficients, OverlapNorms(energy, usable), columns, bandwidth)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a map file keeps: as the kernel takes it, so that map and model share their memory."""
        spectra = {"spectra_real": self.real, "spectra_imaginary": self.imaginary}
        return {**spectra, "coefficients": self.coefficients, "energy": self.norms.energy, "usable": self.norms.usable}

    @classmethod
    def of_arrays(cls, arrays: Arrays, columns: int, bandwidth: float) -> Self:
        """From what `arrays` gave, or those of an earlier version, where spectra are complex numbers."""
        coefficients, energy, usable = (arrays[name] for name in ("coefficients", "energy", "usable"))
        if "spectra" in arrays:
            return cls.of(arrays["spectra"], coefficients, energy, usable, columns, bandwidth)
        norms = OverlapNorms(energy, usable)
        return cls(arrays["spectra_real"], arrays["spectra_imaginary"], coefficients, norms, columns, bandwidth)

    def of_places(self, coefficients: Complex64, energy: Float32, usable: Float32) -> Self:
        """The same eigenimages, for other places."""
        return replace(self, coefficients=coefficients, norms=OverlapNorms(energy, usable))

    def votes(self, z: Complex64, usable: Bool, width: float) -> Float32:
        """Votes of an image for every heading and place, float32 (columns, k)."""
        turned = self.projections(z)
        turned_real = np.hstack([turned.real, turned.imag]).astype(np.float32, copy=False)
        votes = np.asarray(turned_real @ self._coefficients_real.T, dtype=np.float32)
        to_votes(votes, self.norms.of(z, usable), width)
        return votes

    def projections(self, z: Complex64) -> Complex64:
        """Inner products of the turned image with every eigenimage, complex64 (columns, p)."""
        spectrum = np.ascontiguousarray(fft.fft(z, axis=1).T[self._frequencies])
        projections = np.zeros((self.columns, self.coefficients.shape[1]), dtype=np.complex64)
        projections[self._frequencies] = spectra_product(self.real, self.imaginary, spectrum)
        return np.asarray(fft.ifft(projections, axis=0, overwrite_x=True))

    def glance(self, z: Complex64, width: float) -> Float32:
        """Votes by few eigenimages for every place and every fifth heading, without regard to masks: float32 (columns / 5, k)."""
        kept, real, imaginary, coefficients, lengths = self._first
        headings = max(1, self.columns // _GLANCE_COLUMNS)
        spectrum = np.ascontiguousarray(fft.fft(z, axis=1).T[self._frequencies[kept]])
        projections = np.zeros((headings, coefficients.shape[0] // 2), dtype=np.complex64)
        # The frequency of a coarser circle that has the same sign and size.
        signed = np.rint(fft.fftfreq(self.columns, 1.0 / self.columns)[self._frequencies[kept]]).astype(np.int64)
        projections[signed % headings] = spectra_product(real, imaginary, spectrum)
        turned = fft.ifft(projections, axis=0, overwrite_x=True) * np.float32(headings / self.columns)
        votes = np.asarray(np.hstack([turned.real, turned.imag]) @ coefficients, dtype=np.float32)
        image = np.float32(np.sqrt(squared_magnitude(z).sum()))
        to_votes(votes, np.maximum(image * lengths, np.float32(1e-12))[None], width)
        return votes

    @cached_property
    def _first(self) -> tuple[NDArray[np.int64], Float32, Float32, Float32, Float32]:
        """Of a glance: frequencies that are kept, the spectra there, and what is compared with, real parts first."""
        headings = max(1, self.columns // _GLANCE_COLUMNS)
        signed = np.rint(fft.fftfreq(self.columns, 1.0 / self.columns)[self._frequencies])
        kept = np.flatnonzero(np.abs(signed) <= (headings - 1) // 2)
        count = min(_GLANCE_COMPONENTS, self.coefficients.shape[1])
        real, imaginary = (np.ascontiguousarray(part[kept][:, :, :count]) for part in (self.real, self.imaginary))
        first = self.coefficients[:, :count]
        coefficients = np.ascontiguousarray(np.hstack([first.real, first.imag]).astype(np.float32).T)
        return kept, real, imaginary, coefficients, np.sqrt(squared_magnitude(first).sum(axis=1))

    @cached_property
    def _coefficients_real(self) -> Float32:
        # Re(conj(a) b) as one real product: [Re a, Im a] . [Re b, Im b].
        return np.hstack([self.coefficients.real, self.coefficients.imag]).astype(np.float32)

    @cached_property
    def _frequencies(self) -> NDArray[np.int64]:
        """Indices of the lowest row frequencies, both signs, as a transform over all columns orders them."""
        return frequencies_kept(self.columns, self.bandwidth)


def frequencies_kept(columns: int, bandwidth: float) -> NDArray[np.int64]:
    """Indices of the lowest row frequencies, both signs, as a transform over all columns orders them."""
    highest = max(1, int(0.5 * bandwidth * columns))
    return np.flatnonzero(np.abs(np.rint(fft.fftfreq(columns) * columns)) <= highest)

"""An image against all places, at all headings: as votes, and at a glance.

Turning the robot shifts the columns of its panorama, so the projections of the image at *all* headings on an eigenimage are one
circular correlation along the rows: a product of spectra, summed over the rows, and one inverse FFT an eigenimage. Correlations with
places follow by one matrix product.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

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
# By four times as many, places are ranked: by 64 of 93,700 places, the median rank of the true one in uneven light was 39, by 128 one.
_CODE_COMPONENTS, _HEADINGS, _LIKENESS_BLOCK = 128, 72, 4096
_CODES = ("codes", "lengths_of_codes")


class OfPlace(NamedTuple):
    """Of one place: coefficients complex64 (p,), and the blocks of `OverlapNorms`."""

    coefficients: Complex64
    energy: Float32
    usable: Float32


@dataclass(frozen=True, eq=False)
class Correlator:
    """The map's side of the votes.

    Parameters
    ----------
    real, imaginary : float32 (frequencies, rows, p)
        Conjugate row spectra of the eigenimages, in the order that the kernel runs through them.
    coefficients : complex64 (k, p), or float16 (k, 2 p)
        Of the places; of large maps as real parts and imaginary parts after them, in half the room.
    norms : OverlapNorms
        Of the places, of float16 with such coefficients.
    columns : int
        Of a panorama: as many headings are voted on.
    bandwidth : float
        Share of the row frequencies that the spectra hold.
    instead : mapping of int to OfPlace
        Of a large map, what holds for some of the places instead.
    """

    real: Float32
    imaginary: Float32
    coefficients: NDArray[Any]
    norms: OverlapNorms
    columns: int
    bandwidth: float
    instead: Mapping[int, OfPlace] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        spectra: Complex64,
        coefficients: NDArray[Any],
        energy: NDArray[Any],
        usable: NDArray[Any],
        columns: int,
        bandwidth: float,
    ) -> Self:
        """Of conjugate row spectra as complex64 (frequencies, p, rows)."""
        real, imaginary = (np.ascontiguousarray(part.transpose(0, 2, 1)) for part in (spectra.real, spectra.imag))
        return cls(real, imaginary, coefficients, OverlapNorms(energy, usable), columns, bandwidth)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a map file keeps: as the kernel takes it, so that map and model share their memory."""
        spectra = {"spectra_real": self.real, "spectra_imaginary": self.imaginary}
        kept = {**spectra, "coefficients": self.coefficients, "energy": self.norms.energy, "usable": self.norms.usable}
        # Those of a large map are read for every image; its coefficients then need not be in memory.
        return kept if np.iscomplexobj(self.coefficients) else {**kept, **dict(zip(_CODES, self.codes, strict=True))}

    @classmethod
    def of_arrays(cls, arrays: Arrays, columns: int, bandwidth: float) -> Self:
        """From what `arrays` gave, or those of an earlier version, where spectra are complex numbers."""
        coefficients, energy, usable = (arrays[name] for name in ("coefficients", "energy", "usable"))
        if "spectra" in arrays:
            return cls.of(arrays["spectra"], coefficients, energy, usable, columns, bandwidth)
        norms = OverlapNorms(energy, usable)
        made = cls(arrays["spectra_real"], arrays["spectra_imaginary"], coefficients, norms, columns, bandwidth)
        if _CODES[0] in arrays:
            made.__dict__["codes"] = tuple(arrays[name] for name in _CODES)
        return made

    def of_places(self, coefficients: Complex64, energy: Float32, usable: Float32) -> Self:
        """The same eigenimages, for other places."""
        return replace(self, coefficients=coefficients, norms=OverlapNorms(energy, usable), instead={})

    def at(self, places: NDArray[np.int64]) -> Correlator:
        """The same eigenimages, for some of the places."""
        coefficients = complex_of(self.coefficients[places])
        energy, usable = (blocks[places].astype(np.float32, copy=False) for blocks in (self.norms.energy, self.norms.usable))
        for column, place in enumerate(places):
            if place in self.instead:
                coefficients[column], energy[column], usable[column] = self.instead[place]
        return self.of_places(coefficients, energy, usable)

    def with_others(self, others: Mapping[int, OfPlace]) -> Correlator:
        """The same, but for some places."""
        if not np.iscomplexobj(self.coefficients):
            # Copies of a large map would need its memory once more: `likeness` and `at` look up these places in `instead`.
            made = replace(self, instead=others)
            made.__dict__.update(codes=self.codes, _usual_sizes=self._usual_sizes)
            return made
        arrays = self.coefficients.copy(), self.norms.energy.copy(), self.norms.usable.copy()
        for place, of_place in others.items():
            for array, values in zip(arrays, of_place, strict=True):
                array[place] = values
        return self.of_places(*arrays)

    def votes(self, z: Complex64, usable: Bool, width: float, turned: Complex64 | None = None) -> Float32:
        """Votes of an image for every heading and place, float32 (columns, k); `projections` that are known need not be made again."""
        turned = self.projections(z) if turned is None else turned
        turned_real = np.hstack([turned.real, turned.imag]).astype(np.float32, copy=False)
        votes = np.asarray(turned_real @ self._coefficients_real.T, dtype=np.float32)
        to_votes(votes, self.norms.of(z, usable), width)
        return votes

    def projections(self, z: Complex64) -> Complex64:
        """Inner products of the turned image with every eigenimage, complex64 (columns, p)."""
        spectrum = np.ascontiguousarray(fft.fft(z, axis=1).T[self._frequencies])
        projections = np.zeros((self.columns, self.real.shape[2]), dtype=np.complex64)
        projections[self._frequencies] = spectra_product(self.real, self.imaginary, spectrum)
        return np.asarray(fft.ifft(projections, axis=0, overwrite_x=True))

    def glance(self, z: Complex64, width: float, places: NDArray[np.int64] | None = None) -> Float32:
        """Votes by few eigenimages for all places, or some, at every fifth heading, masks or not: float32 (columns / 5, c)."""
        kept, real, imaginary = self._first_spectra
        coefficients, lengths = self._first if places is None else self._glanced_at(places)
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

    def likeness(self, turned: Complex64) -> Float32:
        """The cosine at the best of headings five degrees apart, by `codes`, of every place but for a factor: float32 (k,).

        Parameters
        ----------
        turned : complex64 (columns, p)
            `projections` of the image.
        """
        coefficients, lengths = self.codes
        some = turned[:: max(1, self.columns // _HEADINGS), : coefficients.shape[0] // 2]
        some_real = np.hstack([some.real, some.imag])
        best = np.empty(len(lengths), dtype=np.float32)
        # What is worked out for a block stays in the processor's caches.
        for first in range(0, len(best), _LIKENESS_BLOCK):
            block = slice(first, first + _LIKENESS_BLOCK)
            best[block] = (some_real @ coefficients[:, block]).max(axis=0)
        best /= np.maximum(lengths, np.float32(1e-12))
        if self.instead:
            others = np.array(list(self.instead))
            coefficients, lengths = self._in_usual_sizes(others)
            best[others] = (some_real @ coefficients).max(axis=0) / np.maximum(lengths, np.float32(1e-12))
        return best

    @cached_property
    def codes(self) -> tuple[Float32, Float32]:
        """What places are ranked by: first coefficients and lengths, as of `_codes`, in a metric of their own.

        In a cosine, the first eigenimages would count most, which hold the floor and the walls that all places share. So products are
        taken over the usual size of each coefficient. That of the image need not be divided, too.
        """
        count = len(self.coefficients)
        codes, lengths = np.empty((len(self._usual_sizes), count), np.float32), np.empty(count, np.float32)
        for block in np.array_split(np.arange(count), count // _LIKENESS_BLOCK + 1):
            codes[:, block], lengths[block] = self._in_usual_sizes(block)
        return codes, lengths

    @cached_property
    def _usual_sizes(self) -> Float32:
        """Root mean square of the first coefficients over all places, float32 (2 m, 1), twice in a row."""
        squares = [
            np.square(np.abs(complex_of(block))).sum(axis=0, dtype=np.float64)
            for block in np.array_split(self.coefficients, len(self.coefficients) // _LIKENESS_BLOCK + 1)
        ]
        sizes = np.sqrt(np.sum(squares, axis=0) / len(self.coefficients))[:_CODE_COMPONENTS]
        return np.asarray(np.maximum(np.tile(sizes, 2), 1e-12)[:, None], dtype=np.float32)

    def _in_usual_sizes(self, places: NDArray[np.int64]) -> tuple[Float32, Float32]:
        """First coefficients of some places over their usual sizes, (2 m, c), and their lengths in that metric, (c,)."""
        codes, _ = self._codes(_CODE_COMPONENTS, places)
        scaled = codes / self._usual_sizes
        return scaled, np.sqrt(np.einsum("mc,mc->c", codes, scaled))

    @cached_property
    def _first(self) -> tuple[Float32, Float32]:
        """What a glance compares all places with (see `_codes`)."""
        return self._codes(_GLANCE_COMPONENTS)

    def _glanced_at(self, places: NDArray[np.int64]) -> tuple[Float32, Float32]:
        """The same of some places of a large map; read once, as they lie far apart in it, and most are glanced at again."""
        codes, lengths, known = self._glances
        new = places[~known[places]]
        if len(new):
            read, lengths[new] = self._codes(_GLANCE_COMPONENTS, new)
            codes[new] = read.T
            known[new] = True
        return codes[places].T, lengths[places]

    @cached_property
    def _glances(self) -> tuple[Float32, Float32, Bool]:
        """Codes (k, 2 m) and lengths (k,) of places that were glanced at, and which were. What is not written to takes no memory."""
        count, components = len(self.coefficients), min(_GLANCE_COMPONENTS, self.real.shape[2])
        codes, lengths = np.empty((count, 2 * components), np.float32), np.empty(count, np.float32)
        return codes, lengths, np.zeros(count, dtype=np.bool_)

    def _codes(self, most: int, places: NDArray[np.int64] | None = None) -> tuple[Float32, Float32]:
        """First coefficients of all places, or some, float32 (2 m, c), real parts first, and their lengths, (c,)."""
        count = self.real.shape[2]
        which, first = slice(None) if places is None else places, slice(min(most, count))
        codes = self.coefficients[which, first]
        if not np.iscomplexobj(codes):
            codes = complex_of(np.hstack([codes, self.coefficients[which, count : count + first.stop]]))
            for row, place in enumerate(range(len(codes)) if places is None else places):
                if place in self.instead:
                    codes[row] = self.instead[place].coefficients[first]
        parts = np.hstack([codes.real, codes.imag]).astype(np.float32)
        return np.ascontiguousarray(parts.T), np.sqrt(squared_magnitude(codes).sum(axis=1))

    @cached_property
    def _first_spectra(self) -> tuple[NDArray[np.int64], Float32, Float32]:
        """Of a glance: frequencies that are kept, and the spectra of few eigenimages there."""
        headings = max(1, self.columns // _GLANCE_COLUMNS)
        signed = np.rint(fft.fftfreq(self.columns, 1.0 / self.columns)[self._frequencies])
        kept = np.flatnonzero(np.abs(signed) <= (headings - 1) // 2)
        real, imaginary = (np.ascontiguousarray(part[kept][:, :, :_GLANCE_COMPONENTS]) for part in (self.real, self.imaginary))
        return kept, real, imaginary

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


def complex_of(parts: NDArray[Any]) -> Complex64:
    """Real parts, and after them as many imaginary parts, (k, 2 p), as complex64 (k, p); what is complex stays as it is."""
    if np.iscomplexobj(parts):
        return parts
    real, imaginary = np.hsplit(parts, 2)
    whole = np.empty(real.shape, dtype=np.complex64)
    whole.real, whole.imag = real, imaginary
    return whole


def in_half(coefficients: Complex64) -> NDArray[np.float16]:
    """What `complex_of` makes whole again, float16 (k, 2 p): to 3 digits, which moves a vote by a ten-thousandth."""
    return np.hstack([coefficients.real.astype(np.float16), coefficients.imag.astype(np.float16)])

"""Eigenspace of spinning images.

M. Jogan & A. Leonardis, "Robust localization using panoramic view-based recognition", ICPR 2000, and "Robust localization using an
omnidirectional appearance-based subspace model of environment", Robotics and Autonomous Systems 45, 2003. The eigenspace is that
of all references at all headings. Rotated copies make the matrix of inner products block-circulant, so a DFT over the heading
diagonalises it: at each frequency the eigenspace is that of the references' row spectra there. An eigenimage is a column of complex
weights times a wave around the circle, and a turned view has the same coefficients but for a phase in proportion to frequency and
heading.

Decided here: plain projection (the authors also solve for coefficients robustly from subsets of pixels); images of equal energy, mean
removed (that of all turned copies, which is constant along rows); the eigenimages of largest variance over all frequencies; votes by
distance to each place's turned copies (`distance_votes`), all headings by one inverse DFT a place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.peers.base import Float32, Peer
from panoloc_mcl.laboratory.peers.projection import distance_votes, refuse_equal, unit_energy
from panoloc_mcl.laboratory.peers.settings import SpinningSettings
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

Complex128 = NDArray[np.complex128]


class SpinningModel(Peer[SpinningSettings]):
    """Nearest turned copy in the eigenspace of all of them (model ``spinning``)."""

    name = "spinning"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: SpinningSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Columns of the eigenimages (p, rows), their frequencies (p,), coefficients (k, p), projection of the mean (p,).

        Ordered by frequency.
        """
        refuse_equal(images, cls.name)
        spectra = isometric_spectra(unit_energy(images) if settings.unit_energy else images)
        # Waves around the circle add up to nothing over all headings: the mean only has frequency 0.
        mean = spectra[0].mean(axis=0)
        spectra[0] -= mean
        # Many small problems: on a busy machine several threads took thirty times as long as one.
        with threadpool_limits(1, "blas"):
            values, vectors = np.linalg.eigh(spectra @ spectra.conj().swapaxes(1, 2))
        progress(1, 1, "eigenspace")
        # A wave's variance is shared by its eigenimage and the conjugate one.
        variances = values / _weights(images.shape[2])[:, None]
        ranked = np.argsort(-variances, axis=None, kind="stable")
        rank = int(np.sum(variances > 1e-6 * variances.max()))
        if settings.components > rank:
            raise MapError(
                f"observation.{cls.name}.components = {settings.components}: {len(images)} references at all headings span only "
                f"{rank} eigenimages; set at most {rank}"
            )
        frequencies, indices = np.divmod(np.sort(ranked[: settings.components]), values.shape[1])
        chosen = vectors[frequencies, :, indices]
        # The phase of an eigenvector is free; fix it, so that the same references always give the same map.
        pivots = np.take_along_axis(chosen, np.abs(chosen).argmax(axis=1)[:, None], axis=1)
        chosen = chosen * (pivots.conj() / np.abs(pivots))
        lengths = np.sqrt(values[frequencies, indices])[:, None]
        columns = np.einsum("pk,pkr->pr", chosen.conj(), spectra[frequencies]) / lengths
        return {
            "columns": columns.astype(np.complex64),
            "frequencies": frequencies.astype(np.int32),
            "coefficients": np.ascontiguousarray((chosen * lengths).T, dtype=np.complex64),
            "mean": np.where(frequencies == 0, columns.conj() @ mean, 0.0).astype(np.complex64),
        }

    def votes(self, image: Float32) -> Float32:
        """By distance to each place's coefficients at every phase."""
        kept = self._arrays
        frequencies, coefficients = kept["frequencies"], kept["coefficients"]
        spectrum = isometric_spectra((unit_energy(image) if self.settings.unit_energy else image)[None])[:, 0]
        mine = np.einsum("pr,pr->p", kept["columns"].conj(), spectrum[frequencies]) - kept["mean"]
        first = np.flatnonzero(np.diff(frequencies, prepend=-1))
        # One frequency's products turn together; at real images' paired frequencies irfft counts them twice, so half is given.
        products = np.zeros((self._columns // 2 + 1, len(coefficients)), dtype=np.complex128)
        products[frequencies[first]] = np.add.reduceat((coefficients.conj() * mine).T, first, axis=0)
        products /= _weights(self._columns)[:, None]
        turned = fft.irfft(products, n=self._columns, axis=0) * self._columns
        energy = np.square(np.abs(mine)).sum(keepdims=True)
        return distance_votes(turned, energy, coefficients, self.settings.vote_width)


def isometric_spectra(images: Float32) -> Complex128:
    """Row spectra (f, k, rows) whose real inner products, summed over the half spectrum, are those of the images."""
    columns = images.shape[2]
    spectra = np.moveaxis(fft.rfft(images.astype(np.float64), axis=2, norm="ortho"), 2, 0)
    return np.ascontiguousarray(spectra * np.sqrt(_weights(columns))[:, None, None])


def _weights(columns: int) -> NDArray[np.float64]:
    """How often each frequency of the half spectrum stands in the whole one."""
    weights = np.full(columns // 2 + 1, 2.0)
    weights[0] = 1.0
    if columns % 2 == 0:
        weights[-1] = 1.0
    return weights

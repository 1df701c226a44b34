"""Zero phase representation.

T. Pajdla & V. Hlavac, "Zero phase representation of panoramic images for image based localization", CAIP 1999. Every panorama is
turned until its first harmonic around the circle has phase 0, so that images taken at one place in any heading become the same
image; places are told apart in an eigenspace of such images, and the turn gives the heading.

Decided here: the harmonic is that of the column means; the turn is exact to fractions of a column (a phase in the row spectra); plain
projection of images of equal energy and votes by distance (`distance_votes`). A place has one heading; the field is a Gaussian
around it, whose top has the place's votes in full.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.laboratory.peers.base import Float32, Float64, Peer
from panoloc_mcl.laboratory.peers.projection import centred_eigenspace, distance_votes, unit_energy
from panoloc_mcl.laboratory.peers.settings import ZeroPhaseSettings
from panoloc_mcl.laboratory.peers.spectra import spread_over_headings
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

# Amplitude of the first harmonic in grey levels below which its phase is rounding.
_LEAST_AMPLITUDE = 0.01


class ZeroPhaseModel(Peer[ZeroPhaseSettings]):
    """Nearest neighbour among zero phase images, the heading by the turn (model ``zero_phase``)."""

    name = "zero_phase"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: ZeroPhaseSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Eigenimages (p, pixels), coefficients (k, p), projection of the mean (p,), phases of the references (k,)."""
        harmonics = first_harmonic(images)
        undirected = [
            name for name, harmonic in zip(references.names, harmonics, strict=True) if abs(harmonic) < _LEAST_AMPLITUDE
        ]
        if undirected:
            raise MapError(
                f"reference {name}: has no first harmonic around the circle, so no zero phase; take it out of poses.csv"
                for name in undirected
            )
        turned = np.stack([at_zero_phase(image) for image in images])
        if settings.unit_energy:
            turned = unit_energy(turned)
        eigenspace, mean = centred_eigenspace(turned, settings.components, cls.name)
        progress(1, 1, "eigenspace")
        return {
            "eigenimages": eigenspace.eigenimages,
            "coefficients": eigenspace.coefficients,
            "mean": mean,
            "phases": np.angle(harmonics),
        }

    def problem(self, image: Float32) -> str:
        """Images without a first harmonic have no zero phase either."""
        problem = super().problem(image)
        if not problem and abs(first_harmonic(image)) < _LEAST_AMPLITUDE:
            return "image has no first harmonic"
        return problem

    def votes(self, image: Float32) -> Float32:
        """By distance of the projections, each place at the heading of its turn."""
        kept = self._arrays
        turned = at_zero_phase(image)
        if self.settings.unit_energy:
            turned = unit_energy(turned)
        projection = kept["eigenimages"] @ turned.ravel() - kept["mean"]
        products = (kept["coefficients"] @ projection)[None, :]
        energy = np.square(projection, dtype=np.float64).sum(keepdims=True)
        place_votes = distance_votes(products, energy, kept["coefficients"], self.settings.vote_width)[0]
        # Turning left by the heading takes the heading off the phase.
        headings = kept["phases"] - float(np.angle(first_harmonic(image)))
        # Between two columns' headings a narrower bell would be missed.
        width = max(np.radians(self.settings.heading_width_deg), 2.0 * np.pi / self._columns)
        deviations = angle_difference(self._headings[:, None], headings[None, :]) / width
        return spread_over_headings(place_votes, np.exp(-0.5 * np.square(deviations)).astype(np.float32))


def first_harmonic(images: Float32) -> Any:
    """Complex amplitude of the first harmonic of the column means of images (..., rows, columns), grey levels."""
    means = images.mean(axis=-2, dtype=np.float64)
    waves: NDArray[np.complex128] = np.exp(-2j * np.pi * np.arange(means.shape[-1]) / means.shape[-1])
    return 2.0 / means.shape[-1] * (means @ waves)


def at_zero_phase(image: Float32) -> Float32:
    """The image turned until its first harmonic has phase 0."""
    spectrum = fft.rfft(image.astype(np.float64), axis=1)
    turn: Float64 = np.angle(first_harmonic(image)) * np.arange(spectrum.shape[1])
    return np.asarray(fft.irfft(spectrum * np.exp(-1j * turn), n=image.shape[1], axis=1), dtype=np.float32)

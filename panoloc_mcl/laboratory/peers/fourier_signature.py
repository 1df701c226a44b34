"""Fourier signature.

H. Ishiguro & S. Tsuji, "Image-based memory of environment", IROS 1996; E. Menegatti, T. Maeda & H. Ishiguro, "Image-based memory
for robot navigation using properties of omnidirectional images", Robotics and Autonomous Systems 47, 2004. A panorama is
remembered by the first 15 Fourier coefficients of each row. Magnitudes do not change when the robot turns: the sum of their absolute
differences (L1) tells places apart. Phases change in proportion to frequency and heading: they tell the heading.

Decided here: similarities are scaled so that the most similar place has 1 and the least similar one 0 for every image. The
field over headings is that similarity times how well the phases agree at the heading, in shares of the place's best heading, so that
the magnitudes alone decide the place and the phases alone the heading. Agreement is the sum over rows and frequencies above 0 of
cosines of phase differences, weighted by both magnitudes, because the phase of a coefficient near 0 is noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.laboratory.peers.base import Float32, Peer
from panoloc_mcl.laboratory.peers.settings import FourierSignatureSettings
from panoloc_mcl.laboratory.peers.spectra import spread_over_headings
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

Complex64 = NDArray[np.complex64]


class FourierSignatureModel(Peer[FourierSignatureSettings]):
    """Places by the magnitudes of low row frequencies, the heading by their phases (model ``fourier_signature``).

    With ``heading: none`` it gives no heading.
    """

    name = "fourier_signature"

    def __init__(self, references: ReferencePanoramas, settings: FourierSignatureSettings, arrays: Arrays) -> None:
        super().__init__(references, settings, arrays)
        self.gives_heading = settings.heading != "none"
        self._signatures: Complex64 = arrays["signatures"]
        self._magnitudes = np.abs(self._signatures)

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: FourierSignatureSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Signatures of the references, complex64 (k, rows, frequencies)."""
        most = images.shape[2] // 2
        if settings.frequencies > most:
            raise MapError(
                f"observation.fourier_signature.frequencies = {settings.frequencies}: panoramas of {images.shape[2]} columns have "
                f"{most}; set at most {most}"
            )
        signatures = signature(images, settings.frequencies)
        progress(1, 1, "signatures")
        return {"signatures": signatures}

    def votes(self, image: Float32) -> Float32:
        """Similarity of the magnitudes, spread over the headings by the phases."""
        mine = signature(image, self.settings.frequencies)
        distances = np.abs(self._magnitudes - np.abs(mine)).sum(axis=(1, 2), dtype=np.float64)
        # Where all places are equally similar, all have 1.
        extent = max(float(np.ptp(distances)), np.finfo(np.float64).tiny)
        similarity = (1.0 - (distances - distances.min()) / extent).astype(np.float32)
        if not self.gives_heading:
            return np.asarray(similarity[None, :])
        products = np.einsum("krf,rf->fk", self._signatures.conj(), mine)
        products[0] = 0.0
        return spread_over_headings(similarity, fft.irfft(products, n=self._columns, axis=0))


def signature(images: Float32, frequencies: int) -> Complex64:
    """First Fourier coefficients of each row of images (..., rows, columns), complex64 (..., rows, frequencies)."""
    return np.ascontiguousarray(fft.rfft(images, axis=-1)[..., :frequencies], dtype=np.complex64)

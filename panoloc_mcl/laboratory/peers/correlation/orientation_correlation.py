"""Orientation correlation.

A. J. Fitch, A. Kadyrov, W. J. Christmas & J. Kittler, "Orientation correlation", BMVC 2002. Each pixel becomes the complex sign of
its gradient, z / |z| with z = f_x + i f_y and 0 where the image is flat; the real part of the correlation of two such images, by FFT,
peaks where edges of the same direction and sign of contrast meet, whatever their strength.

Decided here: central differences; no eigenspace and no smoothing; the image is shifted around the circle only (headings, not rows);
the first and last row have no gradient; correlations are divided by both images' norms, and negative ones are no vote.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer, raise_textureless
from panoloc_mcl.laboratory.peers.settings import OrientationCorrelationSettings
from panoloc_mcl.laboratory.peers.spectra import row_spectra, turned_products
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

Complex64 = NDArray[np.complex64]


class OrientationCorrelationModel(Peer[OrientationCorrelationSettings]):
    """Correlation of gradient directions with every reference at every heading (model ``orientation_correlation``)."""

    name = "orientation_correlation"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: OrientationCorrelationSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Spectra of the orientation images, scaled to unit length (columns, k, rows)."""
        signs = orientation_signs(images)
        norms = np.sqrt(np.square(np.abs(signs)).sum(axis=(1, 2), keepdims=True))
        raise_textureless(references, [bool(norm == 0.0) for norm in norms.ravel()])
        progress(1, 1, "orientations")
        return {"spectra": row_spectra(signs / norms)}

    def problem(self, image: Float32) -> str:
        """Images without any gradient have no orientation."""
        return super().problem(image) or ("" if orientation_signs(image).any() else "image has no texture")

    def votes(self, image: Float32) -> Float32:
        """By normalised correlation."""
        signs = orientation_signs(image)
        signs /= np.sqrt(np.square(np.abs(signs)).sum())
        return np.clip(turned_products(self._arrays["spectra"], signs), 0.0, 1.0)


def orientation_signs(images: Float32) -> Complex64:
    """Complex signs of the gradients of images (..., rows, columns), circular along the rows."""
    gradients = np.zeros(images.shape, dtype=np.complex64)
    gradients.real = np.roll(images, -1, axis=-1) - np.roll(images, 1, axis=-1)
    gradients.imag[..., 1:-1, :] = images[..., 2:, :] - images[..., :-2, :]
    gradients[..., [0, -1], :] = 0.0
    lengths = np.abs(gradients)
    return np.asarray(np.where(lengths > 0.0, gradients / np.where(lengths > 0.0, lengths, 1.0), 0.0), dtype=np.complex64)

"""Nearest reference: what ten lines of NumPy do, and what every other model must not lose to.

The image and every reference become normalised gradients, z / (|z| + c) with z = f_x + i f_y; both are correlated around the circle,
and the reference and the turn of the highest correlation are the answer. No eigenspace, no virtual places, no masks, no smoothing.

Decided here: central differences; c in grey levels a pixel; the first and last row have no gradient; correlations are divided by both
images' norms, and negative ones are no vote.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer, raise_textureless
from panoloc_mcl.laboratory.peers.settings import NearestReferenceSettings
from panoloc_mcl.laboratory.peers.spectra import row_spectra, turned_products
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

Complex64 = NDArray[np.complex64]


class NearestReferenceModel(Peer[NearestReferenceSettings]):
    """Correlation of normalised gradients with every reference at every heading (model ``nearest_reference``)."""

    name = "nearest_reference"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: NearestReferenceSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Spectra of the references' normalised gradients, scaled to unit length (columns, k, rows)."""
        gradients = normalised(images, settings.contrast_floor)
        norms = np.sqrt(np.square(np.abs(gradients)).sum(axis=(1, 2), keepdims=True))
        raise_textureless(references, [bool(norm == 0.0) for norm in norms.ravel()])
        progress(1, 1, "gradients")
        return {"spectra": row_spectra(gradients / norms)}

    def problem(self, image: Float32) -> str:
        """Images without any gradient fit nothing."""
        return super().problem(image) or (
            "" if normalised(image, self.settings.contrast_floor).any() else "image has no texture"
        )

    def votes(self, image: Float32) -> Float32:
        """By normalised correlation."""
        gradients = normalised(image, self.settings.contrast_floor)
        gradients /= np.sqrt(np.square(np.abs(gradients)).sum())
        return np.clip(turned_products(self._arrays["spectra"], gradients), 0.0, 1.0)


def normalised(images: Float32, floor: float) -> Complex64:
    """Normalised gradients z / (|z| + c) of images (..., rows, columns), circular along the rows; c in grey levels a pixel."""
    z = np.zeros(images.shape, dtype=np.complex64)
    z.real = 0.5 * (np.roll(images, -1, axis=-1) - np.roll(images, 1, axis=-1))
    z.imag[..., 1:-1, :] = 0.5 * (images[..., 2:, :] - images[..., :-2, :])
    z[..., [0, -1], :] = 0.0
    return np.asarray(z / (np.abs(z) + np.float32(floor)), dtype=np.complex64)

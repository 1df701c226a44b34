"""Least squares over all pixels in the filtered eigenspace.

H. Bischof, H. Wildenauer & A. Leonardis, "Illumination insensitive eigenspaces", ICCV 2001, for localization M. Jogan, A. Leonardis,
H. Wildenauer & H. Bischof, "Mobile robot localization under varying illumination", ICPR 2002: coefficients from filter responses of
the image and of the eigenimages (eq. 2 of Steinbauer & Bischof 2004). Here without their random hypotheses: one system of
equations with every response at every pixel, so nothing is robust but nothing is left to chance either.

Decided here: the paper's three filters and its vote by angle (eqs. 3 and 4); every reference votes by its own angle, where the
paper gives a vote to the nearest one only, which has the same best cell and leaves a field that can be read between places. With
``mean_column`` the mean image is one more unknown, whose coefficient is not looked at.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer
from panoloc_mcl.laboratory.peers.linear_filters import filter_bank
from panoloc_mcl.laboratory.peers.projection import refuse_equal
from panoloc_mcl.laboratory.peers.settings import LeastSquaresSettings
from panoloc_mcl.laboratory.peers.spectra import row_spectra, turned_products
from panoloc_mcl.robot.eigenspace.pca import principal_components
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas


class LeastSquaresModel(Peer[LeastSquaresSettings]):
    """Coefficients by least squares over all filter responses, at every heading (model ``least_squares``)."""

    name = "least_squares"

    def __init__(self, references: ReferencePanoramas, settings: LeastSquaresSettings, arrays: Arrays) -> None:
        super().__init__(references, settings, arrays)
        coefficients = arrays["coefficients"].astype(np.float64)
        lengths = np.linalg.norm(coefficients, axis=1, keepdims=True)
        self._directions = coefficients / np.maximum(lengths, 1e-12)

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: LeastSquaresSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Spectra of the filtered eigenimages (f, q, 3 rows), the inverse of their Gram matrix, and what the mean adds.

        q = p, or p + 1 with the mean as last column.
        """
        refuse_equal(images, cls.name)
        shape = images.shape[1:]
        flat = images.reshape(len(images), -1)
        mean = flat.mean(axis=0, dtype=np.float64).astype(np.float32)
        eigenspace = principal_components(flat - mean, settings.components, f"observation.{cls.name}.components")
        # The mean is scaled to the unit length of the eigenimages; its column only has to have its direction.
        columns = [*eigenspace.eigenimages, *([mean / np.linalg.norm(mean)] if settings.mean_column else [])]
        filtered = np.stack([responses(column.reshape(shape)) for column in columns])
        design = filtered.reshape(len(filtered), -1).astype(np.float64)
        progress(1, 1, "eigenspace")
        subtracted = np.zeros(len(design)) if settings.mean_column else design @ responses(mean.reshape(shape)).ravel()
        return {
            "spectra": row_spectra(filtered),
            # The pseudo-inverse gives directions that the filters wipe out the coefficient 0.
            "inverse_gram": np.linalg.pinv(design @ design.T, hermitian=True),
            "mean": subtracted,
            "coefficients": eigenspace.coefficients,
        }

    def votes(self, image: Float32) -> Float32:
        """By angle of the coefficients."""
        kept = self._arrays
        right = turned_products(kept["spectra"], responses(image)).astype(np.float64) - kept["mean"]
        found = (right @ kept["inverse_gram"])[:, : self._directions.shape[1]]
        lengths = np.linalg.norm(found, axis=1, keepdims=True)
        cosines = found @ self._directions.T / np.maximum(lengths, 1e-12)
        angles = np.arccos(np.clip(cosines, -1.0, 1.0))
        return np.asarray(np.exp(-0.5 * np.square(angles / self.settings.vote_width)), dtype=np.float32)


def responses(image: Float32) -> Float32:
    """Responses of the three filters one below the other, float32 (3 rows, columns)."""
    return filter_bank(image).reshape(-1, image.shape[1])

"""Plain eigenspace projection with nearest neighbour.

H. Murase & S. K. Nayar, "Visual learning and recognition of 3-D objects from appearance", IJCV 14, 1995; for robots: M. Artac,
M. Jogan & A. Leonardis, "Mobile robot localization using an incremental eigenspace model", ICRA 2002. Images of equal energy, mean
removed, are projected on the first principal components by dot products; the reference whose coefficients are nearest is the
answer.

Decided here: references have one heading only, so the image is turned back by every heading before it is projected, all at once by
row spectra; the heading with the nearest reference wins. Votes fall with the distance (`distance_votes`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer
from panoloc_mcl.laboratory.peers.projection import centred_eigenspace, distance_votes, unit_energy
from panoloc_mcl.laboratory.peers.settings import EigenspaceSettings
from panoloc_mcl.laboratory.peers.spectra import row_spectra, turned_products
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas


class EigenspaceModel(Peer[EigenspaceSettings]):
    """Nearest neighbour in an eigenspace of grey levels, at every heading (model ``eigenspace``)."""

    name = "eigenspace"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: EigenspaceSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Spectra of the eigenimages (f, p, rows), coefficients (k, p), projection of the mean (p,)."""
        if settings.unit_energy:
            images = unit_energy(images)
        eigenspace, mean = centred_eigenspace(images, settings.components, cls.name)
        progress(1, 1, "eigenspace")
        return {
            "spectra": row_spectra(eigenspace.eigenimages.reshape(-1, *images.shape[1:])),
            "coefficients": eigenspace.coefficients,
            "mean": mean,
        }

    def votes(self, image: Float32) -> Float32:
        """By distance of the projections."""
        if self.settings.unit_energy:
            image = unit_energy(image)
        kept = self._arrays
        projections = turned_products(kept["spectra"], image) - kept["mean"]
        energy = np.square(projections, dtype=np.float64).sum(axis=1)
        return distance_votes(projections @ kept["coefficients"].T, energy, kept["coefficients"], self.settings.vote_width)

"""How much panoramas look alike, at every turn of one against the other."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Features are averaged over blocks: what is left is alike over some decimetres.
_BLOCK_ROWS, _BLOCK_COLUMNS = 5, 3


class Likeness:
    """How much panoramas look alike at every turn.

    Parameters
    ----------
    references : ReferencePanoramas
    settings : VotesSettings
    """

    def __init__(self, references: ReferencePanoramas, settings: VotesSettings) -> None:
        rows, columns = references.geometry.shape
        self.columns = max(8, columns // _BLOCK_COLUMNS)
        size = (self.columns, max(4, rows // _BLOCK_ROWS))
        self._spectra = np.empty((len(references), size[1], self.columns), dtype=np.complex64)
        for index in range(len(references)):
            z = orientations(references.panorama(index), settings)[0]
            planes = cv2.resize(np.stack([z.real, z.imag], axis=-1), size, interpolation=cv2.INTER_AREA)
            features = planes[..., 0] + 1j * planes[..., 1]
            self._spectra[index] = fft.fft(features / max(float(np.linalg.norm(features)), 1e-9), axis=1)

    def turns(self, index: int, others: Int64) -> Float64:
        """Cosine of one panorama and others at every turn: float64 (others, columns).

        At turn k the panorama ``index`` was taken at a heading of k columns in the frame of the other.
        """
        products = np.einsum("rc,orc->oc", self._spectra[index], self._spectra[others].conj())
        return np.asarray(fft.ifft(products, axis=1).real, dtype=np.float64)

"""The eigenspace of what a camera would see at every place, as images are compared with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.eigenspace.pca import eigenspace_of
from panoloc_mcl.robot.observation.correlator import Correlator, complex_of, frequencies_kept, in_half
from panoloc_mcl.robot.observation.overlap import block_energy, block_usable
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, synthetic_features
from panoloc_mcl.robot.unfinished import Parts

Complex64 = NDArray[np.complex64]

_FEWEST_COMPONENTS, _MOST_COMPONENTS, _PLACES_A_COMPONENT = 60, 200, 8
# Places whose norms are worked out at once.
_TOGETHER = 1024


def _default_components(places: int) -> int:
    """Neighbouring views are alike: so many eigenimages tell so many places apart."""
    return int(np.clip(places // _PLACES_A_COMPONENT, _FEWEST_COMPONENTS, _MOST_COMPONENTS))


def correlator_of(
    references: ReferencePanoramas,
    places: Places,
    settings: VotesSettings,
    synthesizer: ViewSynthesizer | None,
    progress: Progress,
    threads: int,
    parts: Parts,
    large: bool = False,
) -> tuple[Correlator, float]:
    """The views of all places in their eigenspace, and the share of their energy that its eigenimages hold.

    Parameters
    ----------
    references : ReferencePanoramas
    places : Places
    settings : VotesSettings
    synthesizer : ViewSynthesizer or None
        Makes the views; without one they are the references.
    progress : callable (done, total, what)
    threads : int
    parts : Parts
        Where what is done is kept.
    large : bool
        Coefficients and norms in half the room.

    Raises
    ------
    MapError
        More eigenimages asked for than there are.
    """
    rows, columns = references.geometry.shape
    blocks = len(places), *block_usable(np.ones((rows, columns), dtype=np.bool_)).shape
    energy, usable = (np.empty(blocks, dtype=np.float16 if large else np.float32) for _ in range(2))

    def features(index: int) -> Complex64:
        if synthesizer is None:
            z, mask = orientations(references.panorama(index), settings)
        else:
            z, mask = synthetic_features(synthesizer, places.positions[index], settings)
        energy[index], usable[index] = block_energy(z), block_usable(mask)
        return z.ravel()

    eigenspace = eigenspace_of(
        features,
        len(places),
        settings.components,
        _default_components(len(places)),
        "observation.votes.components",
        progress,
        threads,
        parts,
        {"energy": energy, "usable": usable},
        in_half if large else np.asarray,
    )
    coefficients = eigenspace.coefficients
    # The norm of a place is that of its coefficients (eq. 4): what the eigenimages do not hold must not count against it.
    for some in np.array_split(np.arange(len(places)), len(places) // _TOGETHER + 1):
        held = np.sum(np.abs(complex_of(coefficients[some])) ** 2, axis=1)
        energy[some] *= (held / np.maximum(energy[some].sum(axis=(1, 2), dtype=np.float32), 1e-12))[:, None, None]
    kept = frequencies_kept(columns, settings.bandwidth)
    spectra = np.empty((len(kept), len(eigenspace.eigenimages), rows), dtype=np.complex64)
    for index, eigenimage in enumerate(eigenspace.eigenimages):
        spectra[:, index, :] = fft.fft(eigenimage.reshape(rows, columns), axis=1).conj().T[kept]
    return Correlator.of(spectra, coefficients, energy, usable, columns, settings.bandwidth), eigenspace.kept

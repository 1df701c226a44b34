"""On which of several maps a robot is: a discrete Bayes filter, whose measurement is how well an image fits each of them.

The belief over all poses of all maps is a mixture, one particle filter for each map (a Rao-Blackwellised filter whose discrete state is
the map). What one image says of two maps is what it would say of two places of one map: the likelihood of votes, against the best ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.filtering.weights import likelihoods
from panoloc_mcl.robot.observation.field import VoteField

Float64 = NDArray[np.float64]

# Least chance that a robot has been carried anywhere since the last image; and that it has taken a way where there is one.
_LEAST_CARRIED, _TAKEN = 1e-3, 0.5


@dataclass
class FloorBelief:
    """Probabilities of the maps.

    Parameters
    ----------
    names : sequence of str
    probabilities : float64 (n,)
        All alike at the start, by default.
    """

    names: Sequence[str]
    probabilities: Float64 = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if len(self.probabilities) != len(self.names):
            self.probabilities = np.full(len(self.names), 1.0 / len(self.names))

    @property
    def best(self) -> int:
        """Index of the most probable map."""
        return int(np.argmax(self.probabilities))

    def predict(self, ways: Mapping[int, int], carried: float = 0.0) -> None:
        """Before an image.

        Parameters
        ----------
        ways : mapping of int to int
            The robot is at a way that leads from one map (index) to another, and may have taken it.
        carried : float
            Probability that it was carried away, to anywhere on all maps.
        """
        count = len(self.names)
        carried = min(max(carried, _LEAST_CARRIED), 1.0)
        moves = np.full((count, count), carried / count)
        np.fill_diagonal(moves, 1.0 - carried + carried / count)
        for here, there in ways.items():
            taken = _TAKEN * moves[here, here]
            moves[here, here] -= taken
            moves[here, there] += taken
        self.probabilities = self.probabilities @ moves

    def update(self, likelihoods_of_maps: Float64, new: float) -> None:
        """Bayes' rule.

        Parameters
        ----------
        likelihoods_of_maps : float64 (n,)
            Of the image; NaN for a map that it was not compared with: it keeps its odds against all others together.
        new : float
            How much of it is new after the image before: a power.
        """
        asked = ~np.isnan(likelihoods_of_maps)
        if not asked.any():
            return
        weights = self.probabilities.copy()
        weights[asked] *= np.power(np.maximum(likelihoods_of_maps[asked], 1e-300), new)
        before, after = self.probabilities[asked].sum(), weights[asked].sum()
        if after > 0.0:
            weights[asked] *= before / after
            self.probabilities = weights / weights.sum()


def how_well_each_fits(fields: Sequence[VoteField | None]) -> Float64:
    """Likelihood of an image for each map, 1 for the one that it fits best; NaN for maps without a field.

    Where poses were refined, votes count in proportion to the agreement that synthesis finds, as between the candidates of one map. An
    image that no map can use says nothing: 1 for all.

    Parameters
    ----------
    fields : sequence of VoteField or None

    Returns
    -------
    float64 (n,)
    """
    asked = [index for index, votes in enumerate(fields) if votes is not None]
    out = np.full(len(fields), np.nan)
    out[asked] = 1.0
    fitting = {index: votes for index, votes in enumerate(fields) if votes is not None and votes.informative}
    if not fitting:
        return out
    agreements = {index: _agreement(votes) for index, votes in fitting.items()}
    most = max(agreements.values())
    strengths = {
        index: votes.peak.votes * (agreements[index] / most if most > 0.0 and agreements[index] > 0.0 else 1.0)
        for index, votes in fitting.items()
    }
    best = max(strengths, key=lambda index: strengths[index])
    confidences = [votes.confidence for votes in fitting.values() if not math.isnan(votes.confidence)]
    # The image may be wrong about itself, whichever map it fits.
    doubt = max(1.0 - max(confidences), 0.01) if confidences else 0.05
    for index in asked:
        fits = 0.0
        if index in strengths:
            votes = np.array([strengths[index]], dtype=np.float32)
            fits = float(likelihoods(votes, strengths[best], fitting[best].tolerance, 1.0, 0.0)[0])
        out[index] = (1.0 - doubt) * fits + doubt
    return out


def _agreement(votes: VoteField) -> float:
    return 0.0 if votes.measurement is None else float(votes.measurement.agreement.cosine)

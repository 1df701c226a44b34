"""What tells a right best pose from a wrong one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.observation.field import VoteField

Float64 = NDArray[np.float64]

# Where the evidence of refined poses tells how far an image agrees, and its worst third.
_WHOLE, _WEAKEST = 2, 4


def evidence(field: VoteField) -> Float64:
    """What tells a right best pose from a wrong one, the more the larger.

    How far the best votes stand out, their lead over the best rival, and either the votes themselves, or how far the image agrees with
    the view synthesised at the refined pose, how unanimously, and how far in that third of its rows where it does least. float64 (3,)
    or, refined, (5,): logarithms.
    """
    shape = [max(field.standing_out, 1.0), max(field.peak.margin, 3e-3)]
    if field.measurement is None:
        return np.log([*shape, max(field.peak.votes, 1e-2)])
    agreement = field.measurement.agreement
    return np.log([*shape, max(agreement.cosine, 1e-2), max(agreement.unanimity, 0.3), max(agreement.weakest, 1e-2)])


def told_apart(evidence: Float64) -> Float64:
    """Evidence (n, 5) of refined poses, with how far the worst third of the rows agrees told relative to the whole image.

    Then every figure speaks for being right. Where the worst third is told by itself, it is the image as a whole that speaks against it
    if it agrees well: half of an image agrees elsewhere, too.
    """
    apart = evidence.copy()
    apart[:, _WEAKEST] -= evidence[:, _WHOLE]
    return apart


def of_evidence(weights: Float64) -> Float64:
    """Weights (m, 6) on `evidence`, the constant first, of such on what `told_apart` makes of it."""
    weights = weights.copy()
    weights[:, 1 + _WHOLE] -= weights[:, 1 + _WEAKEST]
    return weights

"""How far apart positions are, all over and around each one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Float64 = NDArray[np.float64]

#: A robot need not drive in the tracks of the references: at least this far to all sides the map holds, metres.
LEAST_REACH_M = 0.5
# Nearest neighbours at less than this share of the distance of second ones show the same places once more.
_TWICE = 0.25
# A reference farther than this from all others, and than twice the usual, is taken to stand no sparser than that.
_SPARSEST_M, _SPARSEST_IN_SPACINGS = 2.0, 2.0


def usual_spacing(positions: Float64) -> float:
    """Median distance of a position to its nearest neighbour, metres; 1.0 for a single one. Several at one position are one.

    Where the nearest is usually far nearer than the second one, most places are there twice, and the second one counts.
    """
    distinct = np.unique(positions, axis=0)
    if len(distinct) < 2:
        return 1.0
    nearest = np.median(np.asarray(cKDTree(distinct).query(distinct, k=min(3, len(distinct)))[0])[:, 1:], axis=0)
    return float(nearest[-1] if nearest[0] < _TWICE * nearest[-1] else nearest[0])


def local_spacings(positions: Float64) -> Float64:
    """Distance of every position (n, 2) to its second nearest neighbour, within limits, float64 (n,), metres.

    The nearest one may be the same place once more. On a grid, and along a line, this is the spacing.
    """
    usual = usual_spacing(positions)
    distinct, place = np.unique(positions, axis=0, return_inverse=True)
    if len(distinct) < 2:
        return np.full(len(positions), usual)
    distances = np.asarray(cKDTree(distinct).query(distinct, k=min(3, len(distinct)))[0])[:, -1]
    return np.asarray(np.minimum(distances, max(_SPARSEST_M, _SPARSEST_IN_SPACINGS * usual))[place.ravel()])

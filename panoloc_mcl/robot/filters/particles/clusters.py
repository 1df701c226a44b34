"""Hypotheses among weighted particles: connected cells of a grid over position and heading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.kernels.filtering.hypotheses import hypotheses, occupied_cells

Float32 = NDArray[np.float32]

_CELL_M = 0.4
_HEADING_CELLS = 24
# Cells below this share of the heaviest one's mass belong to a cluster that they touch, but do not link two.
_LINKING_SHARE = 0.01


def find_clusters(particles: CompactPoses, weights: Float32, most: int = 5) -> tuple[Cluster, ...]:
    """Clusters by falling mass; particles in the same or touching cells (0.4 m, 15 degrees) belong together.

    The few stray particles between two hypotheses do not join them, however many particles there are.

    Parameters
    ----------
    particles : CompactPoses
        n of them.
    weights : float32 (n,)
        Sum 1.
    most : int
        How many are returned.
    """
    masses, means, covariances = hypotheses(*particles.arrays, weights, _CELL_M, _HEADING_CELLS, _LINKING_SHARE)
    means[:, :2] += particles.origin
    # Equal masses: the one whose cells come first, so that the order never depends on the sorting algorithm.
    ranking = np.argsort(-masses, kind="stable")[:most]
    return tuple(Cluster(means[label], covariances[label], float(masses[label])) for label in ranking if masses[label] > 0.0)


def occupied_bins(particles: CompactPoses, bin_m: float, around: int) -> int:
    """How many cells of a grid hold particles, with so many around the circle."""
    weights = np.ones(len(particles), dtype=np.float32)
    return len(occupied_cells(*particles.arrays, weights, bin_m, around)[0])

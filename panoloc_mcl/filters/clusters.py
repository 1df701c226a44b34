"""Hypotheses among weighted particles: connected cells of a grid over position and heading."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from panoloc_mcl.filters.estimate import Cluster
from panoloc_mcl.geometry import angle_difference, circular_mean, wrap_angle

Float64 = NDArray[np.float64]

_CELL_M = 0.4
_HEADING_CELLS = 24
# Cells below this share of the heaviest one's mass belong to a cluster that they touch, but do not link two.
_LINKING_SHARE = 0.01
# Half of the 26 neighbours; the other half are the same pairs the other way round.
_NEIGHBOURS = [step for step in itertools.product((-1, 0, 1), repeat=3) if step > (0, 0, 0)]


def weighted_cluster(poses: Float64, weights: Float64, mass: float) -> Cluster:
    """Mean and covariance of particles; headings on the circle.

    Parameters
    ----------
    poses : float64 (n, 3)
    weights : float64 (n,)
        Sum > 0.
    mass : float
        To be noted in the cluster.
    """
    w = weights / weights.sum()
    mean = np.array([w @ poses[:, 0], w @ poses[:, 1], circular_mean(poses[:, 2], w)])
    residuals = np.column_stack([poses[:, 0] - mean[0], poses[:, 1] - mean[1], angle_difference(poses[:, 2], mean[2])])
    return Cluster(mean, (residuals * w[:, None]).T @ residuals, mass)


def find_clusters(poses: Float64, weights: Float64, most: int = 5) -> tuple[Cluster, ...]:
    """Clusters by falling mass; particles in the same or touching cells (0.4 m, 15 degrees) belong together.

    The few stray particles between two hypotheses do not join them, however many particles there are.

    Parameters
    ----------
    poses : float64 (n, 3)
        Metres, radians.
    weights : float64 (n,)
        Sum 1.
    most : int
        How many are returned.
    """
    labels = _labels(poses, weights)
    masses = np.bincount(labels, weights=weights)
    # Equal masses: the one whose particles come first, so that the order never depends on the sorting algorithm.
    order = np.argsort(-masses, kind="stable")[:most]
    clusters = []
    for label in order:
        if masses[label] <= 0.0:
            break
        members = labels == label
        clusters.append(weighted_cluster(poses[members], weights[members], float(masses[label])))
    return tuple(clusters)


def _labels(poses: Float64, weights: Float64) -> NDArray[np.int64]:
    cells = np.floor(poses[:, :2] / _CELL_M).astype(np.int64)
    cells -= cells.min(axis=0) - 1
    turns = np.floor((wrap_angle(poses[:, 2]) + np.pi) * (_HEADING_CELLS / (2.0 * np.pi))).astype(np.int64) % _HEADING_CELLS
    rows = int(cells[:, 1].max()) + 2
    keys = (cells[:, 0] * rows + cells[:, 1]) * _HEADING_CELLS + turns
    occupied, inverse = np.unique(keys, return_inverse=True)
    if len(occupied) == 1:
        return np.zeros(len(poses), dtype=np.int64)
    place, turn = np.divmod(occupied, _HEADING_CELLS)
    pairs = []
    for dx, dy, dt in _NEIGHBOURS:
        wanted = (place + dx * rows + dy) * _HEADING_CELLS + (turn + dt) % _HEADING_CELLS
        found = np.minimum(np.searchsorted(occupied, wanted), len(occupied) - 1)
        hit = np.flatnonzero(occupied[found] == wanted)
        pairs.append(np.stack([hit, found[hit]]))
    edges = np.concatenate(pairs, axis=1)
    masses = np.bincount(inverse, weights=weights)
    heavy = masses >= _LINKING_SHARE * masses.max()
    links = edges[:, heavy[edges].all(axis=0)]
    graph = coo_array((np.ones(links.shape[1], dtype=np.int8), (links[0], links[1])), shape=(len(occupied), len(occupied)))
    labels = np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
    for one, other in (edges, edges[::-1]):
        rim = ~heavy[one] & heavy[other]
        labels[one[rim]] = labels[other[rim]]
    return labels[inverse]

"""Relative poses of keyframes by refinement: the image of one, against views made from another alone.

The engine that reads a pose off an image is turned on the map itself. The source's depth gives views around it; Gauss-Newton on them
finds from where the other image was taken, in the frame of the source.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import PoseRefiner, ViewSynthesizer
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

_KEPT_FEATURES = 96
_NOTHING_KEPT, _KEPT_TOGETHER = Parts(), 32


@dataclass(frozen=True, eq=False)
class PairMeasurements:
    """Relative poses that pairs of images give.

    Parameters
    ----------
    pairs : int64 (m, 2)
        The source, and the one whose image was refined.
    relative : float64 (m, 3)
        Pose of the second's panorama in the frame of the first's, metres and radians.
    covariances : float64 (m, 3, 3)
        As the refinement gives them, in that frame.
    agreement : float64 (m,)
        Cosine between the image and the view at the pose found.
    """

    pairs: Int64
    relative: Float64
    covariances: Float64
    agreement: Float64


def neighbour_pairs(positions: Float64, neighbours: int, farthest_m: float) -> Int64:
    """Every keyframe with its nearest ones, both ways, int64 (m, 2), sorted.

    Parameters
    ----------
    positions : float64 (n, 2)
    neighbours : int
    farthest_m : float
    """
    count = len(positions)
    wanted = min(neighbours + 1, count)
    distances, found = cKDTree(positions).query(positions, k=wanted)
    distances, found = np.reshape(distances, (count, wanted)), np.reshape(found, (count, wanted))
    mine = np.repeat(np.arange(count)[:, None], wanted, axis=1)
    keep = (found != mine) & (distances <= farthest_m)
    one_way = np.column_stack([mine[keep], found[keep]])
    return np.unique(np.concatenate([one_way, one_way[:, ::-1]]), axis=0).astype(np.int64)


def measure_pairs(
    synthesizer: ViewSynthesizer,
    pairs: Int64,
    starts: Float64,
    settings: VotesSettings,
    near: bool = False,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> PairMeasurements:
    """Refine images against views made from one other keyframe each.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
        Of all keyframes, with their depths.
    pairs : int64 (m, 2)
        Source and image.
    starts : float64 (m, 3)
        Relative poses to begin from.
    settings : VotesSettings
    near : bool
        Whether starts are right to a few centimetres.
    progress : callable (done, total, what)
    threads : int
        Sources at work at once; the result does not depend on it.
    parts : Parts
        Where what is done is kept.
    """
    if not len(pairs):
        return PairMeasurements(pairs, np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0))
    references = synthesizer.references
    features = features_of(references, settings)
    by_source = [np.flatnonzero(pairs[:, 0] == source) for source in range(len(references))]

    def work(source: int) -> Iterator[tuple[int, Float64, Float64, float]]:
        rows = by_source[source].tolist()
        if not rows:
            return
        refiner = PoseRefiner(synthesizer.of(np.array([source])), settings)
        origin = np.array([*references.positions[source], 0.0])
        for row in rows:
            start = starts[row].copy()
            start[:2] += origin[:2]
            found = (refiner.polish if near else refiner.refine)(*features(int(pairs[row, 1])), start)
            yield row, between(origin, found.pose), found.covariance, found.agreement.cosine

    rows, *found = parts.listed("pairs of keyframes", len(references), _KEPT_TOGETHER, work, threads, progress)
    order = np.argsort(rows)
    return PairMeasurements(pairs, *(column[order] for column in found))


def features_of(references: ReferencePanoramas, settings: VotesSettings) -> Callable[[int], tuple[Complex64, Bool]]:
    """Features of a keyframe by its index; those used last are kept."""
    return lru_cache(maxsize=_KEPT_FEATURES)(lambda index: orientations(references.panorama(index), settings))

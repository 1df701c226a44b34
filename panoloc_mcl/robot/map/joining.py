"""A later drive and a map in one pose graph: keyframes of both are held against each other, and the map's get better by it.

Keyframes of a survey stay where they are; those of drives move, but for the first, which holds the frame.
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.map.drives.common_errors import common_errors
from panoloc_mcl.robot.map.keyframes import LOOP, Edges, Keyframes
from panoloc_mcl.robot.map.mending import robot_edges
from panoloc_mcl.robot.map.pairs import measure_pairs
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.observation.scale import references_at
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.synthesis import ViewSynthesizer

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Every keyframe of the drive is measured against so many of the map, not farther away than this.
_PARTNERS, _FARTHEST_M = 4, 1.5
_LEAST_SHARE = 0.6
# What holds the frame is off by no more than this.
_FIXED_M, _FIXED_RAD = 1e-4, 1e-4


def joined(keyframes: Keyframes, later: Keyframes) -> Keyframes:
    """Keyframes of both, those of a later drive after the others; no edges between them."""
    count = len(keyframes)
    edges = replace(later.edges, first=later.edges.first + count, second=later.edges.second + count)
    return replace(
        keyframes,
        names=(*keyframes.names, *later.names),
        given=np.concatenate([keyframes.given, later.poses]),
        poses=np.concatenate([keyframes.poses, later.poses]),
        covariances=np.concatenate([keyframes.covariances, later.covariances]),
        times=np.concatenate([keyframes.times, later.times]),
        drives=(*keyframes.drives, *later.drives),
        edges=keyframes.edges.joined(edges),
    )


def settled_together(
    panorama_map: PanoramaMap, later: Keyframes, panoramas: ReferencePanoramas, progress: Progress
) -> Keyframes:
    """Keyframes of a map and of a later drive, with the poses that fit the relative poses of all.

    Parameters
    ----------
    panorama_map : PanoramaMap
    later : Keyframes
        Of the drive, in the map's frame to some centimetres.
    panoramas : ReferencePanoramas
        Of these, turned to heading 0 by their poses.
    progress : callable (done, total, what)
    """
    keyframes = panorama_map.keyframes
    both = joined(keyframes, later)
    between_them = _measured(panorama_map, later, panoramas, progress)
    edges = both.edges.joined(between_them)
    sds = np.full((len(both), 2), np.inf)
    surveyed = np.flatnonzero([not drive for drive in keyframes.drives])
    sds[surveyed] = np.maximum(keyframes.sds[surveyed], [_FIXED_M, _FIXED_RAD])
    if not len(surveyed):
        sds[0] = [_FIXED_M, _FIXED_RAD]
    owner = np.unique(both.drives, return_inverse=True)[1]
    priors = Priors(both.poses.copy(), sds, robust=False)
    solution = solve(both.poses, edges, priors, common=common_errors(edges, both.poses, owner))
    return replace(both, poses=solution.poses, covariances=solution.covariances, edges=solution.edges)


def _measured(panorama_map: PanoramaMap, later: Keyframes, panoramas: ReferencePanoramas, progress: Progress) -> Edges:
    """Relative poses of the drive's keyframes against those of the map that lie near them."""
    votes = panorama_map.observation.votes
    sources = _sources(panorama_map, panoramas)
    if sources is None:
        return Edges.none()
    used, synthesizer = sources
    references = synthesizer.references
    count = len(used)
    distances, nearest = cKDTree(references.positions[:count]).query(later.poses[:, :2], k=min(_PARTNERS, count))
    distances, nearest = np.reshape(distances, (len(later), -1)), np.reshape(nearest, (len(later), -1))
    rows, columns = np.nonzero(distances <= _FARTHEST_M)
    pairs = np.column_stack([nearest[rows, columns], count + rows]).astype(np.int64)
    if not len(pairs):
        return Edges.none()
    apart = references.positions[pairs[:, 1]] - references.positions[pairs[:, 0]]
    starts = np.column_stack([apart, np.zeros(len(pairs))])
    threads = votes.virtual_places.threads or os.cpu_count() or 1
    measured = measure_pairs(synthesizer, pairs, starts, votes, True, progress, threads)
    keyframes = panorama_map.keyframes
    headings = np.concatenate([keyframes.poses[:, 2], later.poses[:, 2]])
    numbered = np.column_stack([used[pairs[:, 0]], len(keyframes) + pairs[:, 1] - count])
    sufficient = _LEAST_SHARE * float(np.median(measured.agreement))
    edges = robot_edges(replace(measured, pairs=numbered), headings, sufficient)
    return replace(edges, kinds=np.full(len(edges), LOOP))


def _sources(panorama_map: PanoramaMap, panoramas: ReferencePanoramas) -> tuple[Int64, ViewSynthesizer] | None:
    """Keyframes that the map makes views from, and these views with the drive's images after them; None where it makes none."""
    arrays, height = panorama_map.arrays, panorama_map.references.camera_height_m
    if "profiles" not in arrays or height is None:
        return None
    used = np.asarray(arrays["used"], dtype=np.int64)
    both = stacked(panorama_map.references.of(used), panoramas)
    profiles = np.asarray(arrays["profiles"], dtype=np.float64)
    columns = profiles.shape[1]
    both = references_at(both, (max(1, round(both.geometry.height * columns / both.geometry.width)), columns))
    every = np.concatenate([profiles, np.ones((len(panoramas), columns))])
    return used, ViewSynthesizer(replace(both, sds=None), every, height)


def stacked(first: ReferencePanoramas, second: ReferencePanoramas) -> ReferencePanoramas:
    """Panoramas of one geometry, the second after the first."""
    valid = None
    if first.valid is not None or second.valid is not None:
        valid = np.concatenate(
            [np.ones(one.pixels.shape, dtype=np.bool_) if one.valid is None else one.valid for one in (first, second)]
        )
    return replace(
        first,
        pixels=np.concatenate([first.pixels, second.pixels]),
        valid=valid,
        positions=np.concatenate([first.positions, second.positions]),
        names=(*first.names, *second.names),
        sds=None,
    )

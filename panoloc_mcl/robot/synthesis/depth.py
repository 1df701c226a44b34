"""Depth of the references by sweeping: which wall distance makes the neighbours' images agree, column by column.

The world around a reference is taken to be the floor out to a vertical wall, at a distance of its own in every column. For each of a
row of distances the neighbours are warped into the reference's view; where the wall really stands there, their features agree.
A neighbour behind a wall never agrees and has no say.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.kernels.warping import column_agreement
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer

Float64 = NDArray[np.float64]

_NEAREST_WALL_M, _FARTHEST_WALL_M = 0.3, 18.0
# A wall is wider than a pixel: agreement is judged over this many degrees.
_SMOOTHING_DEG = 9.0
# Of the rows that a usual column shows; columns of a mask that show fewer have no depth of their own.
_LEAST_SEEN_OF_COLUMN = 0.25


def sweep_profiles(
    references: ReferencePanoramas,
    camera_height_m: float,
    settings: VotesSettings,
    progress: Progress = no_progress,
    threads: int = 1,
) -> Float64:
    """Distance of the wall in every column of every reference.

    Parameters
    ----------
    references : ReferencePanoramas
        At least two at different places.
    camera_height_m : float
        Above the floor.
    settings : VotesSettings
    progress : callable (done, total, what)
    threads : int
        References that are worked on at once; the result does not depend on it.

    Returns
    -------
    float64 (n, columns)
        Metres.
    """
    count, _, columns = references.pixels.shape
    synthesizer = ViewSynthesizer(references, np.ones((count, columns)), camera_height_m)
    tree = cKDTree(references.positions)
    # References at the same place show no depth; there may be several.
    alike = int(np.unique(references.positions, axis=0, return_counts=True)[1].max())
    wanted = min(settings.virtual_places.neighbours + alike, count)

    def profile_of(index: int) -> Float64:
        distances, nearest = (np.atleast_1d(part) for part in tree.query(references.positions[index], k=wanted))
        neighbours = [int(n) for d, n in zip(distances, nearest, strict=True) if n != index and d > 0.0]
        return _profile(index, neighbours[: settings.virtual_places.neighbours], synthesizer, settings)

    profiles = np.empty((count, columns))
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for index, profile in enumerate(pool.map(profile_of, range(count))):
            profiles[index] = profile
            progress(index + 1, count, "depth of references")
    return profiles


def _profile(index: int, neighbours: list[int], synthesizer: ViewSynthesizer, settings: VotesSettings) -> Float64:
    references = synthesizer.references
    columns = references.geometry.width
    walls = np.geomspace(_NEAREST_WALL_M, _FARTHEST_WALL_M, settings.virtual_places.wall_distances)
    z, usable = orientations(references.panorama(index), settings)
    agreement = np.zeros((len(walls), columns))
    energy = np.full((len(walls), columns), 1e-3)
    for neighbour in neighbours:
        for row, wall in enumerate(walls):
            view = synthesizer.view(neighbour, references.positions[index], np.full(columns, wall))
            warped, seen = orientations(view, settings)
            common, mine, theirs = column_agreement(z, usable, warped, seen)
            agreement[row] += common
            energy[row] += 0.5 * (mine + theirs)
    width = max(1, round(_SMOOTHING_DEG * columns / 360.0))
    score = uniform_filter1d(agreement, width, axis=1, mode="wrap") / uniform_filter1d(energy, width, axis=1, mode="wrap")
    profile = _peaks(score, np.log(walls))
    return profile if references.valid is None else _bridged(profile, usable)


def _bridged(profile: Float64, usable: NDArray[np.bool_]) -> Float64:
    """A profile (columns,) whose hidden columns take the wall over from those beside them: what stands behind a mask is not known."""
    rows_seen = usable.sum(axis=0)
    seen = np.flatnonzero(rows_seen > _LEAST_SEEN_OF_COLUMN * np.median(rows_seen))
    if len(seen) in (0, len(profile)):
        return profile
    return np.asarray(np.exp(np.interp(np.arange(len(profile)), seen, np.log(profile[seen]), period=len(profile))))


def _peaks(score: Float64, log_walls: Float64) -> Float64:
    """Wall distance of the highest score of every column, between the distances tried by a parabola."""
    columns = np.arange(score.shape[1])
    best = np.argmax(score, axis=0)
    inner = np.clip(best, 1, len(score) - 2)
    before, here, after = (score[inner + step, columns] for step in (-1, 0, 1))
    curvature = before - 2.0 * here + after
    sharp = (curvature < 0.0) & (inner == best)
    offset = np.where(sharp, 0.5 * (before - after) / np.where(sharp, curvature, -1.0), 0.0)
    return np.asarray(np.exp(log_walls[best] + offset * (log_walls[1] - log_walls[0])))

"""Depth of the references by sweeping: which wall distance makes the neighbours' images agree, column by column.

The world around a reference is taken to be the floor out to a vertical wall, at a distance of its own in every column. For each of a
row of distances the neighbours are warped into the reference's view; where the wall really stands there, their features agree.
A neighbour behind a wall never agrees and has no say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.kernels.warping import column_agreement
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]

#: Whatever lies within has been compared in every room so far.
CORE_DEG = (-60.0, 30.0)
_FEWEST_CORE_ROWS = 8
_NEAREST_WALL_M, _FARTHEST_WALL_M = 0.3, 18.0
# A wall is wider than a pixel: agreement is judged over this many degrees.
_SMOOTHING_DEG = 9.0
# The second time around, in steps of the first: halves the errors of relative poses on rendered references 1 m apart.
_CLOSER = (-0.6, -0.3, 0.0, 0.3, 0.6)
_NOTHING_KEPT, _KEPT_TOGETHER = Parts(), 64
# Of the rows that a usual column shows; columns of a mask that show fewer have no depth of their own.
_LEAST_SEEN_OF_COLUMN = 0.25


def sweep_profiles(
    references: ReferencePanoramas,
    camera_height_m: float,
    settings: VotesSettings,
    progress: Progress = no_progress,
    threads: int = 1,
    neighbours: Sequence[Sequence[int]] | None = None,
    parts: Parts = _NOTHING_KEPT,
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
    neighbours : sequence of sequence of int, optional
        Of every reference, those that its depth is judged by; the nearest if left out.
    parts : Parts
        Where what is done is kept.

    Returns
    -------
    float64 (n, columns)
        Metres.
    """
    references = references if references.tall else with_rows(references, core_rows(references.geometry))
    count, _, columns = references.pixels.shape
    synthesizer = ViewSynthesizer(references, np.ones((count, columns)), camera_height_m)
    tree = cKDTree(references.positions)
    # References at the same place show no depth; there may be several.
    alike = int(np.unique(references.positions, axis=0, return_counts=True)[1].max())
    wanted = min(settings.virtual_places.neighbours + alike, count)

    def profile_of(index: int) -> Iterator[tuple[Float64]]:
        around = nearest_to(index) if neighbours is None else list(neighbours[index])
        yield (_profile(index, around, synthesizer, settings),)

    def nearest_to(index: int) -> list[int]:
        distances, nearest = (np.atleast_1d(part) for part in tree.query(references.positions[index], k=wanted))
        around = [int(n) for d, n in zip(distances, nearest, strict=True) if n != index and d > 0.0]
        return around[: settings.virtual_places.neighbours]

    return parts.listed("depth of references", count, _KEPT_TOGETHER, profile_of, threads, progress)[0]


def core_rows(geometry: PanoramaGeometry) -> slice:
    """Rows in which floors and walls stand in any room: depths are told by these alone, as a ceiling has another one. All, if few."""
    elevations = np.degrees(geometry.elevation_of_row(np.arange(geometry.height)))
    core = np.flatnonzero((elevations >= CORE_DEG[0]) & (elevations <= CORE_DEG[1]))
    return slice(0, geometry.height) if len(core) < _FEWEST_CORE_ROWS else slice(int(core[0]), int(core[-1]) + 1)


def with_rows(references: ReferencePanoramas, rows: slice) -> ReferencePanoramas:
    """The references with some of their rows only."""
    geometry = references.geometry
    if rows == slice(0, geometry.height):
        return references
    return replace(
        references,
        pixels=np.ascontiguousarray(references.pixels[:, rows]),
        valid=None if references.valid is None else references.valid[:, rows],
        geometry=geometry.of_rows(rows.start, rows.stop),
    )


def fit_of_depths(index: int, neighbours: list[int], synthesizer: ViewSynthesizer, settings: VotesSettings) -> float:
    """How well neighbours agree with a reference (cosine) with the wall of every column where they agree best."""
    tried = _tried(synthesizer, settings)
    return float(_scores(index, neighbours, np.exp(tried), synthesizer, settings).max(axis=0).mean())


def _tried(synthesizer: ViewSynthesizer, settings: VotesSettings) -> Float64:
    """Logarithms of the wall distances that are tried in every column, (k, columns)."""
    logs = np.log(np.geomspace(_NEAREST_WALL_M, _FARTHEST_WALL_M, settings.virtual_places.wall_distances))
    return np.repeat(logs[:, None], synthesizer.references.geometry.width, axis=1)


def _profile(index: int, neighbours: list[int], synthesizer: ViewSynthesizer, settings: VotesSettings) -> Float64:
    tried = _tried(synthesizer, settings)
    logs = tried[:, 0]
    coarse = best_of_columns(_scores(index, neighbours, np.exp(tried), synthesizer, settings), tried)
    # Again around the best of every column: a peak between two of a few distances is off by some percent, and always to one side.
    around = coarse + (logs[1] - logs[0]) * np.array(_CLOSER)[:, None]
    fine = best_of_columns(_scores(index, neighbours, np.exp(around), synthesizer, settings), around)
    return np.asarray(np.exp(np.clip(fine, logs[0], logs[-1])))


def _scores(
    index: int, neighbours: list[int], walls: Float64, synthesizer: ViewSynthesizer, settings: VotesSettings
) -> Float64:
    """How well neighbours agree with a reference if its walls stand at distances (k, columns), around every column."""
    references = synthesizer.references
    z, usable = orientations(references.panorama(index), settings)
    agreement, energy = np.zeros(walls.shape), np.full(walls.shape, 1e-3)
    for neighbour in neighbours:
        for row, wall in enumerate(walls):
            view = synthesizer.view(neighbour, references.positions[index], wall)
            warped, seen = orientations(view, settings)
            common, mine, theirs = column_agreement(z, usable, warped, seen)
            agreement[row] += common
            energy[row] += 0.5 * (mine + theirs)
    width = max(1, round(_SMOOTHING_DEG * walls.shape[1] / 360.0))
    return np.asarray(
        uniform_filter1d(agreement, width, axis=1, mode="wrap") / uniform_filter1d(energy, width, axis=1, mode="wrap")
    )


def best_of_columns(score: Float64, logs: Float64) -> Float64:
    """Where every column's score is highest, between what was tried by a parabola.

    Parameters
    ----------
    score : float64 (k, columns)
    logs : float64 (k, columns)
        What was tried, logarithms of distances in equal steps.

    Returns
    -------
    float64 (columns,)
    """
    columns = np.arange(score.shape[1])
    best = np.argmax(score, axis=0)
    inner = np.clip(best, 1, len(score) - 2)
    before, here, after = (score[inner + step, columns] for step in (-1, 0, 1))
    curvature = before - 2.0 * here + after
    sharp = (curvature < 0.0) & (inner == best)
    offset = np.where(sharp, 0.5 * (before - after) / np.where(sharp, curvature, -1.0), 0.0)
    return np.asarray(logs[best, columns] + offset * (logs[1] - logs[0]))

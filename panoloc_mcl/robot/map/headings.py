"""Headings of references that nobody measured, or only coarsely, from their images.

Images of neighbours, warped to each other's places, tell the turns between them (`turns.py`). Headings that were given, however coarse,
fix a turn that all have in common; where none was, neighbours tell that, too, and by how much it may be wrong: the farther apart they
are, the better. Mending then works on what is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.map.pairs import neighbour_pairs
from panoloc_mcl.robot.map.turns import PairScores, likeliest_headings, pair_scores, turns_at
from panoloc_mcl.robot.observation.scale import references_at
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, References, read_references
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.spacing import usual_spacing

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# From this standard deviation on a heading is found anew, radians: mending follows smaller errors by itself.
_COARSE = np.radians(5.0)
# Of a heading that is given without one.
_GIVEN = np.radians(1.0)
# Headings are found with so many columns at most: fractions of a column are read off the peak.
_COLUMNS = 120
# Neighbours beyond so many usual distances show other things.
_FAR_IN_SPACINGS = 2.5
# Turns that fit no better than this were not found, radians.
_NOT_FOUND = np.radians(20.0)
# References, pairs of them at most, and distances in those asked for, that a common turn is told by; turns are tried in such steps.
_FEWEST, _PAIRS, _APART, _STEP = 8, 64, 0.95, np.radians(2.0)
# A common turn is not thought surer than this, radians.
_LEAST_SD = np.radians(0.5)


def with_headings(
    source: References, votes: VotesSettings, settings: MapSettings, progress: Progress = no_progress, threads: int = 1
) -> tuple[References, tuple[str, ...]]:
    """References whose headings are all known well enough to be mended, and what the user should know.

    Parameters
    ----------
    source : References
        A standard deviation of the heading without end says that it is not known.
    votes : VotesSettings
    settings : MapSettings
    progress : callable (done, total, what)
    threads : int

    Raises
    ------
    DatasetError, ImageError
        As `read_references`, of references with such headings.
    """
    sds = _sds(source, settings)
    coarse = sds >= _COARSE
    if not coarse.any() or len(source) < 2:
        return source, ()
    panoramas = _small(read_references(source, progress))
    pairs = _pairs(panoramas.positions, settings.neighbours)
    found, residual_sd = likeliest_headings(pair_scores(panoramas, pairs, votes, sds, progress, threads), sds)
    common, doubts = _common_turns(panoramas, pairs, found, sds, votes, settings.neighbours, progress, threads)
    found = found + common
    poses, all_sds = source.poses.copy(), np.full((len(source), 2), np.nan) if source.sds is None else source.sds.copy()
    poses[coarse, 2] = wrap_angle(poses[coarse, 2] + found[coarse])
    # Turns err alike along a row of references: no heading is thought surer than half a column.
    all_sds[coarse, 1] = np.hypot(max(residual_sd, np.pi / panoramas.geometry.width), doubts[coarse])
    told = (
        f"headings of {int(coarse.sum())} of {len(source)} references found from their images; turns between neighbours fit them to "
        f"{np.degrees(residual_sd):.1f} degrees"
    )
    if np.isinf(doubts[coarse]).any():
        told += "; too few stand together to tell how all of these are turned: give theta of one of them"
    if residual_sd > _NOT_FOUND:
        told += "; their images are too unlike to tell: give theta in poses.csv, or take references nearer to each other"
    return replace(source, poses=poses, sds=all_sds), (told,)


def _sds(source: References, settings: MapSettings) -> Float64:
    """Standard deviations of the given headings, radians (n,)."""
    given = _GIVEN if settings.sd_theta_deg is None else np.radians(settings.sd_theta_deg)
    sds = np.full(len(source), given)
    if source.sds is not None:
        sds = np.where(np.isnan(source.sds[:, 1]), sds, source.sds[:, 1])
    return sds


def _small(panoramas: ReferencePanoramas) -> ReferencePanoramas:
    rows, columns = panoramas.geometry.shape
    width = min(columns, _COLUMNS)
    return references_at(panoramas, (max(1, round(rows * width / columns)), width))


def _pairs(positions: Float64, neighbours: int) -> Int64:
    """Neighbouring places by the first reference at each, and this with every other one there, int64 (m, 2).

    A robot that stood has taken many at one place: among these alone, none would have a neighbour elsewhere.
    """
    places, first, place = np.unique(positions.round(3), axis=0, return_index=True, return_inverse=True)
    pairs = neighbour_pairs(places, neighbours, _FAR_IN_SPACINGS * usual_spacing(places))
    others = np.setdiff1d(np.arange(len(positions)), first)
    between, at_one = first[pairs[pairs[:, 0] < pairs[:, 1]]], np.column_stack([first[place.ravel()[others]], others])
    return np.sort(np.concatenate([between, at_one]), axis=1).astype(np.int64)


def _common_turns(
    panoramas: ReferencePanoramas,
    pairs: Int64,
    headings: Float64,
    sds: Float64,
    votes: VotesSettings,
    neighbours: int,
    progress: Progress,
    threads: int,
) -> tuple[Float64, Float64]:
    """What is left to turn each reference with all that pairs join to it, and the standard deviation of that.

    Where headings are given, these have told already.
    """
    count = len(sds)
    joined = csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, parts = connected_components(joined, directed=False)
    common, doubts = np.zeros(count), np.full(count, np.inf)
    for part in range(parts.max() + 1):
        mine = np.flatnonzero(parts == part)
        known = mine[np.isfinite(sds[mine])]
        if len(known):
            doubts[mine] = 1.0 / np.sqrt(np.sum(1.0 / np.square(sds[known])))
        elif len(mine) > 1:
            some = panoramas.of(mine)
            common[mine], doubts[mine] = _common_turn(some, headings[mine], votes, neighbours, progress, threads)
    return common, doubts


def _common_turn(
    panoramas: ReferencePanoramas, headings: Float64, votes: VotesSettings, neighbours: int, progress: Progress, threads: int
) -> tuple[float, float]:
    """The turn of all headings (n,) together at which neighbours warped to each other's places fit best, and its standard deviation.

    Images of near references hardly tell it, as things in them hardly move; so it is asked of some that are farther and farther apart,
    and the surest answer counts.
    """
    positions = panoramas.positions
    chosen = np.unique(positions.round(3), axis=0, return_index=True)[1]
    spacing, answers = usual_spacing(positions[chosen]) if len(chosen) > 1 else 0.0, list[tuple[float, float]]()
    while len(chosen) > 1 and (not answers or len(chosen) >= _FEWEST):
        pairs = _pairs(positions[chosen], neighbours)
        pairs = pairs[np.unique(np.linspace(0, len(pairs) - 1, _PAIRS).round().astype(int))] if len(pairs) else pairs
        nothing_known = np.full(len(chosen), np.inf)
        scores = pair_scores(panoramas.of(chosen), pairs, votes, nothing_known, progress, threads)
        if len(pairs):
            answers.append(_best_turn(scores, headings[chosen]))
        spacing *= 2.0
        chosen = _thinned(positions, _APART * spacing)
    return min(answers, key=lambda answer: answer[1], default=(0.0, np.inf))


def _best_turn(scores: PairScores, headings: Float64) -> tuple[float, float]:
    """The common turn that pairs tell, and its standard deviation: by leaving out one reference after the other (jackknife)."""
    turns = np.arange(0.0, 2.0 * np.pi, _STEP)
    of_pairs = scores.by_common_turn(headings, turns)
    left = np.array([(scores.pairs != one).all(axis=1) for one in np.unique(scores.pairs)])
    sums = np.array([of_pairs.sum(axis=0), *(of_pairs[some].sum(axis=0) for some in left)])
    best, *without = turns_at(sums, sums.argmax(axis=1)).tolist()
    if not left.any(axis=1).all():
        return best, np.inf
    off = wrap_angle(np.array(without) - best)
    return best, float(np.hypot(np.sqrt((len(off) - 1) * np.var(off)), _LEAST_SD))


def _thinned(positions: Float64, apart: float) -> Int64:
    """References, one after the other, that are so far from all that were taken before, metres."""
    taken: list[int] = []
    for index, position in enumerate(positions):
        if all(np.hypot(*(position - positions[other])) >= apart for other in taken):
            taken.append(index)
    return np.array(taken, dtype=np.int64)

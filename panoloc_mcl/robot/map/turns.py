"""Headings that nobody knows, from the images of neighbours and where these stand.

Where a neighbour stands is known, but not where it lies in an image whose heading is not. So all directions are tried: the image is
warped to the place that the neighbour would have, at several depths, and compared with the neighbour's at all turns between both; every
column takes the depth that fits it best. In a corridor, images a metre apart are alike in no other way.

The headings that explain all pairs best are found on a tree of the clearest pairs, by dynamic programming, then one by one from
all their neighbours (iterated conditional modes: Besag, "On the statistical analysis of dirty pictures", 1986). Least squares, which
outliers hardly move, then take the turns between neighbours to fractions of a column.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, vstack
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.sparse.linalg import lsqr

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

# Directions that a neighbour is looked for in, and how far off what is seen may be, in distances to the neighbour.
_DIRECTIONS, _DEPTHS = 24, (0.5, 1.0, 2.0, 4.0, 10.0, 1e6)
# Without a height the floor is as far off as can be. Of what stands at one place, depths must not be 0.
_NO_FLOOR_M, _LEAST_M = 1e9, 0.01
# Standard deviations within which headings are looked for; another turn than the best is farther from it than this, radians.
_LIKELY, _OTHER_TURN, _LEAST_LEAD = 3.0, np.radians(20.0), 0.01
_UNLIKELY = np.float32(-1e6)
_SWEEPS, _ROUNDS, _LEAST_SD = 20, 10, np.radians(0.1)
_KEPT_TABLES, _KEPT_TOGETHER = 2048, 64


@dataclass(frozen=True, eq=False)
class PairScores:
    """How well the images of pairs fit each other.

    Parameters
    ----------
    pairs : int64 (m, 2)
    forth, back : float32 (m, directions, columns)
        Correlations of the first image warped to the second, and of the second warped to the first: at each heading of the one that is
        warped, and at each turn from it to the other. Minus infinity at headings that are not likely.
    """

    pairs: Int64
    forth: Float32
    back: Float32

    def table(self, pair: int) -> Float32:
        """Logarithms of the likelihood of the headings of both, but for a constant, float32 (columns, columns)."""
        return _by_both(_likelihoods(self.forth[pair])) + _by_both(_likelihoods(self.back[pair])).T

    def by_common_turn(self, headings: Float64, turns: Float64) -> Float64:
        """Correlations of each pair where all headings (n,) are turned by each of some turns (k,), radians; float64 (m, k)."""
        first, second = headings[self.pairs[:, 0]], headings[self.pairs[:, 1]]
        return _around(self.forth, first, second - first, turns) + _around(self.back, second, first - second, turns)


def _by_both(scores: Float32) -> Float32:
    """Scores by heading and turn as ones by heading and heading."""
    directions, columns = scores.shape
    at = np.arange(columns) * (directions / columns)
    before = at.astype(np.int64)
    share = (at - before).astype(np.float32)[:, None]
    finer = (1.0 - share) * scores[before] + share * scores[(before + 1) % directions]
    every = np.arange(columns)
    return np.asarray(np.take_along_axis(finer, (every[None, :] - every[:, None]) % columns, axis=1), dtype=np.float32)


def _around(scores: Float32, headings: Float64, turns: Float64, common: Float64) -> Float64:
    """Scores (m, directions, columns) of pairs at their turn (m,) and at headings (m,) that are all turned by each of (k,)."""
    count, directions, columns = scores.shape
    at = np.mod(turns, 2.0 * np.pi) * (columns / (2.0 * np.pi))
    before = np.floor(at).astype(np.int64)
    share, rows = (at - before)[:, None], np.arange(count)
    by_direction = (1.0 - share) * scores[rows, :, before % columns] + share * scores[rows, :, (before + 1) % columns]
    # Between directions as a Fourier series.
    waves = np.fft.fft(by_direction, axis=1) / directions
    angles = headings[:, None] + common[None]
    series = np.exp(1j * np.fft.fftfreq(directions, 1.0 / directions)[None, :, None] * angles[:, None, :])
    return np.asarray(np.einsum("md,mdk->mk", waves, series).real)


def pair_scores(
    panoramas: ReferencePanoramas,
    pairs: Int64,
    votes: VotesSettings,
    sds: Float64,
    progress: Progress = no_progress,
    threads: int = 1,
) -> PairScores:
    """Compare the images of pairs at all headings of both.

    Parameters
    ----------
    panoramas : ReferencePanoramas
        Turned to heading 0 by the headings that are given.
    pairs : int64 (m, 2)
    votes : VotesSettings
    sds : float64 (n,)
        Of the given headings: farther off none is looked for.
    progress : callable (done, total, what)
    threads : int
    """
    height = _NO_FLOOR_M if panoramas.camera_height_m is None else panoramas.camera_height_m
    columns = panoramas.geometry.width
    warped = ViewSynthesizer(panoramas, np.ones((len(panoramas), columns)), height)
    features = [_stacked(*orientations(panoramas.panorama(index), votes)) for index in range(len(panoramas))]
    headings = wrap_angle(2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS)
    every = np.arange(columns)
    turned = (every[:, None] + every[None, :]) % columns

    def one_way(first: int, second: int) -> Float32:
        step = panoramas.positions[second] - panoramas.positions[first]
        distance = max(float(np.hypot(*step)), _LEAST_M)
        scores = np.full((_DIRECTIONS, columns), -np.inf, dtype=np.float32)
        likely = np.abs(headings) <= _LIKELY * sds[first] + 2.0 * np.pi / _DIRECTIONS
        for row in np.flatnonzero(likely):
            c, s = np.cos(headings[row]), np.sin(headings[row])
            place = panoramas.positions[first] + np.array([c * step[0] + s * step[1], c * step[1] - s * step[0]])
            best = np.full((columns, columns), -np.inf, dtype=np.float32)
            for depth in _DEPTHS:
                view = warped.view(first, place, np.full(columns, depth * distance))
                np.maximum(best, _stacked(*orientations(view, votes)).T @ features[second], out=best)
            # Content moves to larger columns when the heading grows.
            scores[row] = np.take_along_axis(best, turned, axis=1).sum(axis=0)
        return scores

    def work(pair: int) -> Iterator[tuple[Float32, Float32]]:
        first, second = pairs[pair].tolist()
        yield one_way(first, second), one_way(second, first)

    if not len(pairs):
        return PairScores(pairs, *np.zeros((2, 0, _DIRECTIONS, columns), dtype=np.float32))
    return PairScores(pairs, *Parts().listed("headings of pairs", len(pairs), _KEPT_TOGETHER, work, threads, progress))


def _stacked(z: NDArray[np.complex64], valid: NDArray[np.bool_]) -> Float32:
    """Real over imaginary parts, 0 where nothing is seen: the real part of an inner product is an inner product of these."""
    return np.concatenate([np.where(valid, z.real, 0.0), np.where(valid, z.imag, 0.0)]).astype(np.float32)


def _likelihoods(scores: Float32) -> Float32:
    """Logarithms of the likelihood of scores (directions, columns) that stand out so far among those of other turns.

    Where scores of other turns have the standard deviation 1, one that stands out by z has the log likelihood z^2 / 2. Of the
    directions at a turn, that counts for the best only; another one's lags by the difference of both z. Scores of directions differ
    little, and pixels next to each other err alike, so that squares would make too much of it.
    """
    likely = np.isfinite(scores[:, 0])
    known = scores[likely]
    middle = np.median(known, axis=1, keepdims=True)
    spread = 1.4826 * np.median(np.abs(known - middle), axis=1, keepdims=True)
    z = np.full(scores.shape, _UNLIKELY)
    z[likely] = (known - middle) / np.maximum(spread, np.float32(1e-6))
    best = z.max(axis=0)
    return np.asarray(0.5 * np.square(np.maximum(best, 0.0)) + (z - best), dtype=np.float32)


def likeliest_headings(scores: PairScores, sds: Float64) -> tuple[Float64, float]:
    """Corrections of headings that explain all pairs best, and the standard deviation of what is left of the turns between them.

    What is left is that of the best turns anywhere, so where images tell nothing it is large.

    Parameters
    ----------
    scores : PairScores
    sds : float64 (n,)
        Of the given headings, whose correction is 0 but for this; without end where none is given.
    """
    pairs, count, columns = scores.pairs, len(sds), scores.forth.shape[-1]
    if not len(pairs):
        return np.zeros(count), _LEAST_SD
    table = lru_cache(maxsize=_KEPT_TABLES)(scores.table)
    every = wrap_angle(2.0 * np.pi * np.arange(columns) / columns)
    by_turn = np.stack([_best_of_turns(table(pair)) for pair in range(len(pairs))])
    # Turns that both headings make unlikely were tried only because each of these was likely.
    apart = np.hypot(sds[pairs[:, 0]], sds[pairs[:, 1]])
    by_turn = np.where(np.abs(every)[None] <= np.maximum(_LIKELY * apart, 2.0 * np.pi / columns)[:, None], by_turn, _UNLIKELY)
    leads = _leads(by_turn, every)
    prior = -0.5 * np.square(every[None] / sds[:, None])
    found = every[_labels(pairs, leads, table, prior)]
    turns = _turns_near(by_turn, wrap_angle(found[pairs[:, 1]] - found[pairs[:, 0]]), every)
    found, residual = refined(pairs, turns, np.square(np.minimum(leads / np.median(leads), 1.0)), found, sds)
    best = _turns_near(by_turn, every[by_turn.argmax(axis=1)], every)
    left = wrap_angle(best - (found[pairs[:, 1]] - found[pairs[:, 0]]))
    return found, max(residual, 1.4826 * float(np.median(np.abs(left))))


def _best_of_turns(table: Float32) -> Float32:
    """The best score of every turn from the first heading to the second, whatever the first is."""
    every = np.arange(len(table))
    return np.asarray(np.take_along_axis(table, (every[:, None] + every[None, :]) % len(table), axis=1).max(axis=0))


def _leads(by_turn: Float32, every: Float64) -> Float64:
    """By how much the best turn of each pair leads the best one elsewhere."""
    best = by_turn.argmax(axis=1)
    elsewhere = np.abs(wrap_angle(every[None] - every[best][:, None])) > _OTHER_TURN
    leads = by_turn.max(axis=1) - np.where(elsewhere, by_turn, -np.inf).max(axis=1)
    return np.asarray(np.maximum(leads, _LEAST_LEAD), dtype=np.float64)


def _labels(pairs: Int64, leads: Float64, table: Callable[[int], Float32], prior: Float64) -> Int64:
    """The likeliest heading of each reference, as a number of columns, int64 (n,)."""
    count = len(prior)
    of_pair = {(a, b): pair for pair, (a, b) in enumerate(pairs.tolist())}

    def from_to(one: int, other: int) -> Float32:
        return table(of_pair[one, other]) if (one, other) in of_pair else table(of_pair[other, one]).T

    labels = np.zeros(count, dtype=np.int64)
    tree = minimum_spanning_tree(csr_matrix((1.0 / leads, (pairs[:, 0], pairs[:, 1])), shape=(count, count)))
    _, parts = connected_components(tree, directed=False)
    order: list[int] = []
    for part in range(parts.max() + 1):
        nodes, above = breadth_first_order(tree, int(np.flatnonzero(parts == part)[0]), directed=False)
        branches, choices = {node: prior[node] for node in nodes.tolist()}, {}
        for node in nodes[:0:-1].tolist():
            through = from_to(int(above[node]), node) + branches[node][None]
            choices[node] = through.argmax(axis=1)
            branches[int(above[node])] = branches[int(above[node])] + through.max(axis=1)
        labels[nodes[0]] = branches[int(nodes[0])].argmax()
        for node in nodes[1:].tolist():
            labels[node] = choices[node][labels[above[node]]]
        order += nodes.tolist()
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for a, b in of_pair:
        neighbours[a].append(b)
        neighbours[b].append(a)
    for _ in range(_SWEEPS):
        before = labels.copy()
        for node in order:
            labels[node] = (prior[node] + sum(from_to(other, node)[labels[other]] for other in neighbours[node])).argmax()
        if np.array_equal(labels, before):
            break
    return labels


def _turns_near(by_turn: Float32, turns: Float64, every: Float64) -> Float64:
    """The best turn of each pair around one that is known roughly, to fractions of a column."""
    near = np.abs(wrap_angle(every[None] - turns[:, None])) <= _OTHER_TURN
    return turns_at(by_turn, np.where(near, by_turn, -np.inf).argmax(axis=1))


def turns_at(values: NDArray[np.floating], best: Int64) -> Float64:
    """Where values at turns all around the circle, (m, k), are largest about the column ``best`` (m,) of each, radians (m,).

    Fractions of a column are those of a parabola through the neighbours.
    """
    rows, count = np.arange(len(values)), values.shape[1]
    before, here, after = (values[rows, (best + step) % count].astype(np.float64) for step in (-1, 0, 1))
    bend = before - 2.0 * here + after
    part = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return np.asarray(wrap_angle(2.0 * np.pi / count * (best + np.clip(part, -0.5, 0.5))))


def refined(pairs: Int64, turns: Float64, weights: Float64, start: Float64, sds: Float64) -> tuple[Float64, float]:
    """Corrections of headings that meet the turns between pairs, and the standard deviation of what is left of these.

    Parameters
    ----------
    pairs : int64 (m, 2)
    turns, weights : float64 (m,)
        Correction of the second less that of the first, radians, by their images, and how far it is trusted, up to 1.
    start : float64 (n,)
        Corrections that are nearly right. What no turn and no given heading tells (a turn of all together) stays as it is.
    sds : float64 (n,)
        Of the given headings, whose correction is 0 but for this; without end where none is given.
    """
    count, found, scale = len(sds), start.copy(), _LEAST_SD
    rows = np.arange(len(pairs))
    differences = coo_matrix((np.tile([-1.0, 1.0], len(pairs)), (np.repeat(rows, 2), pairs.ravel())), shape=(len(pairs), count))
    known = np.flatnonzero(np.isfinite(sds))
    for _ in range(_ROUNDS):
        left = wrap_angle(turns - (found[pairs[:, 1]] - found[pairs[:, 0]]))
        scale = max(1.4826 * float(np.median(np.abs(left))) if len(left) else 0.0, _LEAST_SD)
        # Cauchy's weights: a turn that is far off has next to none.
        trusted = np.sqrt(weights) / (scale * np.sqrt(1.0 + np.square(left / (2.0 * scale))))
        held = coo_matrix((1.0 / sds[known], (np.arange(len(known)), known)), shape=(len(known), count))
        system = vstack([differences.multiply(trusted[:, None]), held]).tocsr()
        right = np.concatenate([trusted * left, -wrap_angle(found[known]) / sds[known]])
        found = found + np.asarray(lsqr(system, right, atol=1e-10, btol=1e-10, iter_lim=2000)[0])
    return np.asarray(wrap_angle(found)), scale

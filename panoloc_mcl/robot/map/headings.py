"""Headings of references that nobody measured, or only coarsely, from their images.

Images of neighbours tell the turns between them, and, less surely, the headings themselves (`turns.py`). Headings that were given,
however coarse, fix a turn that all have in common; where none was, parallax does: only in the right frame do views warped from one
place to the next agree better than the images as they are. Mending then works on what is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from panoloc_mcl.robot.geometry import compose, wrap_angle
from panoloc_mcl.robot.map.pairs import neighbour_pairs
from panoloc_mcl.robot.map.turns import likeliest_headings, pair_scores
from panoloc_mcl.robot.observation.scale import references_at
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, References, read_references
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles
from panoloc_mcl.robot.synthesis.plausibility import agreements
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
# Common turns that are tried, and references that they are tried on: groups of neighbours from all over the map.
_TURNS, _GROUPS, _GROUP = 24, 3, 6
_RESAMPLES = 200


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
    pairs = neighbour_pairs(panoramas.positions, settings.neighbours, _FAR_IN_SPACINGS * usual_spacing(panoramas.positions))
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    found, residual_sd = likeliest_headings(pair_scores(panoramas, pairs, votes, sds, progress, threads), sds)
    common, doubts, note = _common_turns(panoramas, pairs, found, sds, votes, threads)
    found = found + common
    poses, all_sds = source.poses.copy(), np.full((len(source), 2), np.nan) if source.sds is None else source.sds.copy()
    poses[coarse, 2] = wrap_angle(poses[coarse, 2] + found[coarse])
    all_sds[coarse, 1] = np.hypot(residual_sd, doubts[coarse])
    told = (
        f"headings of {int(coarse.sum())} of {len(source)} references found from their images; turns between neighbours fit them to "
        f"{np.degrees(residual_sd):.1f} degrees{note}"
    )
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


def _common_turns(
    panoramas: ReferencePanoramas, pairs: Int64, headings: Float64, sds: Float64, votes: VotesSettings, threads: int
) -> tuple[Float64, Float64, str]:
    """What is left to turn each reference with all that pairs join to it, the standard deviation of that, and what to say of it.

    Where headings are given, these have told already.
    """
    count = len(sds)
    _, parts = connected_components(
        csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count)), directed=False
    )
    common, doubts, note = np.zeros(count), np.full(count, np.inf), ""
    for part in range(parts.max() + 1):
        mine = np.flatnonzero(parts == part)
        known = mine[np.isfinite(sds[mine])]
        if len(known):
            doubts[mine] = 1.0 / np.sqrt(np.sum(1.0 / np.square(sds[known])))
        elif len(mine) > 1:
            common[mine], doubts[mine], note = _common_turn(panoramas.of(mine), headings[mine], votes, threads)
    return common, doubts, note


def _common_turn(
    panoramas: ReferencePanoramas, headings: Float64, votes: VotesSettings, threads: int
) -> tuple[float, float, str]:
    """The turn of all headings (n,) together at which warping gains most, its standard deviation, and what to say of it."""
    height = panoramas.camera_height_m
    if height is None:
        return 0.0, np.inf, "; all of them may be turned by one angle: give camera.height_m, or the heading of one reference"
    columns = panoramas.geometry.width
    shifts = np.rint(headings * columns / (2.0 * np.pi)).astype(int)
    chosen = _groups(panoramas.positions)
    level = panoramas.of(chosen)
    # At heading 0 all show what they would have shown in a frame that is turned by the common angle alone.
    level = replace(level, pixels=np.stack([np.roll(p, -s, axis=1) for p, s in zip(level.pixels, shifts[chosen], strict=True)]))
    if level.valid is not None:
        level = replace(
            level, valid=np.stack([np.roll(v, -s, axis=1) for v, s in zip(level.valid, shifts[chosen], strict=True)])
        )
    turns = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    gains = np.empty((_TURNS, len(chosen)))
    for index, turn in enumerate(turns):
        turned = replace(
            level, positions=compose(np.array([0.0, 0.0, -turn]), np.pad(level.positions, ((0, 0), (0, 1))))[:, :2]
        )
        synthesizer = ViewSynthesizer(turned, sweep_profiles(turned, height, votes, threads=threads), height)
        gains[index] = agreements(synthesizer, votes, threads=threads).warped
    return *_best_turn(gains), ""


def _best_turn(gains: Float64) -> tuple[float, float]:
    """Where references (turns, n) gain most on the mean, and how much that depends on which are asked (bootstrap: Efron 1979)."""
    gains = gains[:, np.isfinite(gains).all(axis=0)]
    if not gains.size:
        return 0.0, np.inf
    step = 2.0 * np.pi / len(gains)
    asked = np.random.default_rng(0).integers(gains.shape[1], size=(_RESAMPLES, gains.shape[1]))
    means = gains[:, asked].mean(axis=2)
    best, every = means.argmax(axis=0), np.arange(_RESAMPLES)
    before, here, after = (means[(best + offset) % len(gains), every] for offset in (-1, 0, 1))
    bend = before - 2.0 * here + after
    peaks = np.exp(1j * step * (best + np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)))
    middle = peaks.mean()
    spread = float(np.sqrt(-2.0 * np.log(max(abs(middle), 1e-9))))
    # A peak is read off a parabola through turns that are a step apart.
    return float(np.angle(middle)), float(np.hypot(spread, 0.25 * step))


def _groups(positions: Float64) -> Int64:
    middles = np.linspace(0, len(positions) - 1, _GROUPS + 2).round().astype(int)[1:-1]
    _, nearest = cKDTree(positions).query(positions[middles], k=min(_GROUP, len(positions)))
    return np.unique(nearest).astype(np.int64)

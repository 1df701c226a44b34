"""Loop closures: keyframes that were taken near each other, though not one after the other.

Proposed by likeness of images among those that odometry lets be near, so that the mirror image of a corridor is none; verified by
refinement in both directions. The pose graph then accepts those that agree with each other and with the way between.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference, between, compose, wrap_angle
from panoloc_mcl.robot.map.drives.likeness import Likeness
from panoloc_mcl.robot.map.keyframes import LOOP, Edges
from panoloc_mcl.robot.map.mending import robot_edges
from panoloc_mcl.robot.map.pairs import PairMeasurements, measure_pairs
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# Features are averaged over blocks: what is left is alike over some decimetres.
_BLOCK_ROWS, _BLOCK_COLUMNS = 5, 3
# Partners of every keyframe that are looked at more closely.
_PARTNERS = 2
# Both directions must agree.
_SAME_M, _SAME_RAD = 0.08, np.radians(2.0)
_NOTHING_KEPT = Parts()


def proposed(
    likeness: Likeness, poses: Float64, headings: Float64, gate_m: Float64, gate_rad: Float64, apart: Bool
) -> tuple[Int64, Float64]:
    """Pairs that look alike where they may be near each other.

    Parameters
    ----------
    likeness : Likeness
    poses : float64 (n, 3)
        Of keyframes, as far as they are known.
    headings : float64 (n,)
        By which the panoramas were turned to heading 0.
    gate_m, gate_rad : float64 (n, n)
        How far two poses may be off each other.
    apart : bool (n, n)
        Pairs that are not one after the other.

    Returns
    -------
    pairs : int64 (m, 2)
        Source and image.
    turns : float64 (m,)
        Heading of the image's panorama in the frame of the source's, radians.
    """
    count = len(poses)
    step = 2.0 * np.pi / likeness.columns
    angles = np.asarray(wrap_angle(step * np.arange(likeness.columns)))
    panorama = wrap_angle(poses[:, 2] - headings)
    pairs, turns = [], []
    for index in range(count):
        near = np.hypot(*(poses[:, :2] - poses[index, :2]).T) <= gate_m[index]
        others = np.flatnonzero(near & apart[index])
        if not len(others):
            continue
        scores = likeness.turns(index, others)
        expected = angle_difference(panorama[index], panorama[others])
        off = np.abs(angle_difference(angles[None, :], expected[:, None]))
        scores = np.where(off <= gate_rad[index, others][:, None], scores, -1.0)
        best = scores.max(axis=1)
        for row in np.argsort(-best, kind="stable")[:_PARTNERS]:
            pairs.append((int(others[row]), index))
            turns.append(float(angles[int(np.argmax(scores[row]))]))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2), np.array(turns)


def verified(
    synthesizer: ViewSynthesizer,
    pairs: Int64,
    turns: Float64,
    headings: Float64,
    settings: VotesSettings,
    sufficient: float,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> Edges:
    """Edges of those pairs whose images agree, in both directions.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
    pairs, turns : int64 (m, 2) and float64 (m,)
        As `proposed` gives them.
    headings : float64 (n,)
        By which the panoramas were turned to heading 0.
    settings : VotesSettings
    sufficient : float
        Agreement (cosine) of a pair that counts.
    progress : callable (done, total, what)
    threads : int
    parts : Parts
        Where what is done is kept.
    """
    if not len(pairs):
        return Edges.none()
    starts = np.column_stack([np.zeros((len(pairs), 2)), turns])
    there = measure_pairs(synthesizer, pairs, starts, settings, False, progress, threads, parts)
    good = there.agreement >= sufficient
    if not good.any():
        return Edges.none()
    back_starts = between(there.relative[good], np.zeros(3))
    back = measure_pairs(synthesizer, pairs[good][:, ::-1], back_starts, settings, True, progress, threads, parts)
    closed = compose(there.relative[good], back.relative)
    same = (np.hypot(closed[:, 0], closed[:, 1]) < _SAME_M) & (np.abs(closed[:, 2]) < _SAME_RAD)
    kept = np.flatnonzero(good)[same & (back.agreement >= sufficient)]
    both = same & (back.agreement >= sufficient)
    edges = robot_edges(_some(there, kept), headings, sufficient).joined(
        robot_edges(_some(back, np.flatnonzero(both)), headings, sufficient)
    )
    return Edges(edges.first, edges.second, edges.measured, edges.covariances, np.full(len(edges), LOOP), edges.weights)


def _some(measured: PairMeasurements, rows: Int64) -> PairMeasurements:
    return PairMeasurements(measured.pairs[rows], measured.relative[rows], measured.covariances[rows], measured.agreement[rows])

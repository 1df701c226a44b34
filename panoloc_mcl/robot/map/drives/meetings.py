"""Where a drive meets a map: the one rigid motion that many of its keyframes agree on, each of which looks like some place there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference, compose, inverse, wrap_angle
from panoloc_mcl.robot.map.drives.likeness import Likeness
from panoloc_mcl.robot.map.pairs import measure_pairs
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Places of the map that every keyframe is compared with more closely, and of how many keyframes.
_PARTNERS, _MOST = 3, 40
# Keyframes agree on a motion within this; so many must, and so many times as many as on any other.
_SAME_M, _SAME_RAD = 0.5, np.radians(8.0)
_FEWEST, _LEAD = 4, 1.5
# Keyframes that agree must lie this far from each other: one place may look like another by chance, a way does not.
_SPREAD_M = 1.0
_NOTHING_KEPT = Parts()


def meeting(
    synthesizer: ViewSynthesizer,
    likeness: Likeness,
    poses: Float64,
    headings: Float64,
    theirs: Int64,
    mine: Int64,
    settings: VotesSettings,
    sufficient: float,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> Float64 | None:
    """Poses of a drive's keyframes in the frame of others; None where it never meets them, or nobody can say where.

    Parameters
    ----------
    synthesizer, likeness
        Of all keyframes.
    poses : float64 (n, 3)
        Of all keyframes; those of the drive in a frame of its own.
    headings : float64 (n,)
        By which the panoramas were turned to heading 0.
    theirs, mine : int64
        Keyframes of the others, and of the drive.
    settings : VotesSettings
    sufficient : float
        Agreement (cosine) of a pair that counts.
    threads : int
    parts : Parts
        Where what is done is kept.
    """
    sampled = mine[np.unique(np.linspace(0, len(mine) - 1, min(len(mine), _MOST)).round().astype(np.int64))]
    pairs, turns = [], []
    for index in sampled:
        scores = likeness.turns(int(index), theirs)
        best = scores.max(axis=1)
        for row in np.argsort(-best, kind="stable")[:_PARTNERS]:
            pairs.append((int(theirs[row]), int(index)))
            turns.append(2.0 * np.pi * int(np.argmax(scores[row])) / likeness.columns)
    starts = np.column_stack([np.zeros((len(pairs), 2)), wrap_angle(turns)])
    measured = measure_pairs(synthesizer, np.array(pairs), starts, settings, threads=threads, parts=parts)
    good = measured.agreement >= sufficient
    if good.sum() < _FEWEST:
        return None
    first, second = measured.pairs[good].T
    panorama = np.column_stack([poses[:, :2], wrap_angle(poses[:, 2] - headings)])
    there = compose(panorama[first], measured.relative[good])
    there[:, 2] = wrap_angle(there[:, 2] + headings[second])
    motion = agreed_motion(there, poses[second])
    return None if motion is None else compose(motion, poses[mine])


def agreed_motion(there: Float64, here: Float64) -> Float64 | None:
    """The rigid motion (3,) that most poses agree on; None if too few do, or others agree on another one.

    Parameters
    ----------
    there, here : float64 (m, 3)
        The same poses in both frames; many of them may be wrong.
    """
    motions = compose(there, inverse(here))
    votes, members = _votes(motions, there, here)
    best = int(np.argmax(votes))
    agreed = members[best]
    others = [votes[k] for k in range(len(motions)) if not agreed[k]]
    spread = np.ptp(here[agreed][:, :2], axis=0).max()
    if votes[best] < _FEWEST or votes[best] < _LEAD * max(others, default=0) or spread < _SPREAD_M:
        return None
    return _mean(motions[agreed])


def _votes(motions: Float64, there: Float64, here: Float64) -> tuple[list[int], list[NDArray[np.bool_]]]:
    """How many keyframes every motion brings to where their images fit, and which measurements these are."""
    votes, members = [], []
    for motion in motions:
        moved = compose(motion, here)
        near = np.hypot(*(moved - there)[:, :2].T) < _SAME_M
        agreed = near & (np.abs(angle_difference(moved[:, 2], there[:, 2])) < _SAME_RAD)
        votes.append(len(np.unique(here[agreed], axis=0)))
        members.append(agreed)
    return votes, members


def _mean(motions: Float64) -> Float64:
    turn = float(np.arctan2(np.sin(motions[:, 2]).mean(), np.cos(motions[:, 2]).mean()))
    return np.array([*np.median(motions[:, :2], axis=0), turn])

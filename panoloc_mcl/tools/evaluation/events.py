"""What happened in one run: found itself, was sure and wrong, lost its track, came back after a kidnap.

All functions look at one record with truth; a run is cut into segments at its teleports.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation.definitions import (
    HOLD_S,
    LOST_S,
    MIN_FRAMES_TO_END,
    ROUNDING_S,
    SUCCESS_TO_END_S,
    BoolArray,
    is_bad,
    is_good,
)
from panoloc_mcl.tools.evaluation.record import SequenceRecord


@dataclass(frozen=True)
class RunEvents:
    """Events of one run.

    Attributes
    ----------
    succeeded : bool
        Global success: before the first teleport there is a stretch of frames that are all converged and good (under 0.5 m
        and 10°), and it lasts 10 s, or reaches the end of that part and lasts 3 s.
    falsely_converged : bool
        Some frame is converged and bad (above 1.0 m or 20°). A teleport excuses nothing: the image after it has been seen.
    tracks_lost : int or None
        Stretches of bad frames that last more than 3 s, after the robot was localised (converged and good) in the same
        segment. The next loss counts only after a recovery. None when the robot never was localised.
    frames_to_recover : tuple of (int or None)
        For each teleport the number of images up to the first of the recovered stretch, 1 for the first image after the
        teleport; None when the robot did not recover. Teleports with fewer than 3 frames after them are left out, for
        no robot could show a recovery there.
    """

    succeeded: bool
    falsely_converged: bool
    tracks_lost: int | None
    frames_to_recover: tuple[int | None, ...]


def find_events(record: SequenceRecord) -> RunEvents | None:
    """Events of a run, as far as its frames have truth; None if none has."""
    judged = record.judged
    if judged is None:
        return None
    record = judged
    position, heading = record.position_error_m, record.heading_error_deg
    if position is None or heading is None:
        return None
    good, bad, converged, times = is_good(position, heading), is_bad(position, heading), record.converged, record.times
    segments = _segments(record.kidnapped)
    first = segments[0]
    found = first_lasting(converged[first] & good[first], times[first], min_frames_to_end=1, seconds_to_end=SUCCESS_TO_END_S)
    losses = [_tracks_lost(good[s], bad[s], converged[s], times[s]) for s in segments]
    counted = [loss for loss in losses if loss is not None]
    recoveries = (first_lasting(good[s], times[s]) for s in segments[1:] if s.stop - s.start >= MIN_FRAMES_TO_END)
    return RunEvents(
        succeeded=found is not None,
        falsely_converged=bool((converged & bad).any()),
        tracks_lost=sum(counted) if counted else None,
        frames_to_recover=tuple(None if start is None else start + 1 for start in recoveries),
    )


def first_lasting(
    good: BoolArray,
    times: FloatArray,
    *,
    seconds: float = HOLD_S,
    min_frames_to_end: int = MIN_FRAMES_TO_END,
    seconds_to_end: float = 0.0,
) -> int | None:
    """First frame of the first stretch of good frames that lasts.

    Parameters
    ----------
    good : ndarray of bool, shape (n,)
    times : ndarray of float64, shape (n,)
        Seconds.
    seconds : float
        A stretch lasts when its last stamp is this much later than its first one.
    min_frames_to_end : int
        It also lasts when it reaches the last frame with at least this many frames, …
    seconds_to_end : float
        … and is at least this long.
    """
    for start, last in _stretches(good):
        lasted = times[last] - times[start] + ROUNDING_S
        long_enough = lasted >= seconds
        to_the_end = last == len(good) - 1 and last - start + 1 >= min_frames_to_end and lasted >= seconds_to_end
        if long_enough or to_the_end:
            return start
    return None


def _segments(kidnapped: BoolArray) -> list[slice]:
    cuts = [0, *(int(i) for i in np.flatnonzero(kidnapped)), len(kidnapped)]
    return [slice(a, b) for a, b in itertools.pairwise(cuts)]


def _stretches(flags: BoolArray) -> Iterator[tuple[int, int]]:
    """First and last index of every unbroken stretch of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield int(start), int(stop) - 1


def _tracks_lost(good: BoolArray, bad: BoolArray, converged: BoolArray, times: FloatArray) -> int | None:
    localised = np.flatnonzero(converged & good)
    if not len(localised):
        return None
    count, since = 0, int(localised[0])
    for start, last in _stretches(bad):
        if start < since or times[last] - times[start] <= LOST_S + ROUNDING_S:
            continue
        count += 1
        recovered = first_lasting(good[last + 1 :], times[last + 1 :])
        if recovered is None:
            break
        since = last + 1 + recovered
    return count

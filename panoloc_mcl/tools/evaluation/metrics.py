"""Every figure of ``metrics.json``.

Definitions
-----------
* A frame *is converged* when its status is ``converged``. *After convergence* means the frames from the first converged
  frame of a run on, whatever their status, teleports included; runs that never converge have none.
* Errors are unaligned, in the map frame. Pooled errors are those of all frames together, never averages of averages;
  pooled rates are over runs (recognition: over frames, kidnaps: over teleports).
* ``ape_rmse_m`` is over all frames and equals what ``evo_ape tum groundtruth.tum trajectory.tum`` prints.
* Recognition: a frame after convergence *passes* a place when the true position is within 0.15 m of the nearest one; the
  place is *recognised* when the reported one is that place (or one at the same distance). Each frame counts. Runs that
  never name a place take no part.
* ``frames_to_converge`` counts images up to and with the first converged one; seconds count from the first image. In the
  medians over runs (and over teleports for ``frames_to_recover``) one that never got there counts as later than all
  others; when that makes the median endless, it is None.
* ``false_convergence`` counts runs, not frames. What it is, and what success, loss and recovery are, says ``events``.
* Intervals of rates (``wilson95``) are over drives, whose images and runs err alike: Wilson's, each drive one trial, where every
  drive is all or nothing; by bootstrap over drives where some are in between. A kidnap's trial is the teleport, of which every run
  repeats the same. More runs over the same drives narrow none.
* ``consistency`` holds errors against claimed covariances, over all converged frames: what it is, says `consistency`.
* Figures that need truth look only at runs that have it. What does not apply is None.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.tools.evaluation.consistency import consistency
from panoloc_mcl.tools.evaluation.definitions import (
    METRICS_SCHEMA,
    PASS_RADIUS_M,
    ROUNDING,
    WITHIN_TIERS,
    BoolArray,
    is_within,
)
from panoloc_mcl.tools.evaluation.events import RunEvents, find_events
from panoloc_mcl.tools.evaluation.intervals import interval95_over_drives
from panoloc_mcl.tools.evaluation.record import SequenceRecord

Metrics = dict[str, Any]


def evaluate(records: Sequence[SequenceRecord], place_positions: ArrayLike | None) -> Metrics:
    """All figures: overall, by group and by sequence.

    Parameters
    ----------
    records : sequence of SequenceRecord
        Runs over sequences, in any order; each pair of sequence and run once.
    place_positions : array_like of float, shape (P, 2), or None
        Where the places are, map frame, metres; ``best_place`` of the records counts in it.

    Returns
    -------
    dict
        Plain numbers, lists and None, as ``metrics.json`` holds them.

    Raises
    ------
    ResultsError
        No records, a run given twice, or a place that is not in the list.
    """
    places = _checked_places(place_positions)
    # A fixed order makes sums, and so the figures, the same to the last bit for the same runs.
    ordered = sorted(records, key=lambda record: (record.name, record.run))
    _check_records(ordered, places)
    return {
        "schema": METRICS_SCHEMA,
        "overall": _figures(ordered, places),
        "groups": {group: _figures(runs, places) for group, runs in _by(ordered, "group").items()},
        "sequences": {name: _figures(runs, places) for name, runs in _by(ordered, "name").items()},
    }


def _checked_places(place_positions: ArrayLike | None) -> FloatArray:
    places = np.zeros((0, 2)) if place_positions is None else np.asarray(place_positions, dtype=np.float64)
    if places.size == 0:
        return np.zeros((0, 2))
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise ResultsError(f"place_positions has shape {places.shape}; give finite x and y of each place, shape (P, 2)")
    return places


def _check_records(records: Sequence[SequenceRecord], places: FloatArray) -> None:
    if not records:
        raise ResultsError("no runs to evaluate; run at least one sequence")
    faults = [
        f"sequence '{a.name}', run {a.run}: given twice; give each run once"
        for a, b in itertools.pairwise(records)
        if (a.name, a.run) == (b.name, b.run)
    ]
    if len(places):
        faults += [
            f"sequence '{r.name}', run {r.run}: best_place {r.best_place.max()} is not among the {len(places)} places; "
            "give the places of the map that the run used"
            for r in records
            if r.best_place.max() >= len(places)
        ]
    if faults:
        raise ResultsError(faults)


def _by(records: Iterable[SequenceRecord], attribute: str) -> dict[str, list[SequenceRecord]]:
    parts: dict[str, list[SequenceRecord]] = {}
    for record in records:
        parts.setdefault(getattr(record, attribute), []).append(record)
    return dict(sorted(parts.items()))


def _figures(records: Sequence[SequenceRecord], places: FloatArray) -> Metrics:
    events = [(record.name, found) for record in records if (found := find_events(record)) is not None]
    return {
        "frames": sum(len(record) for record in records),
        "runs": len(records),
        **_accuracy(records),
        "recognition": _recognition(records, places),
        "global_success": _global_success(events),
        "false_convergence": _false_convergence(events),
        **_time_to_converge(records),
        "tracks_lost": _tracks_lost([found for _, found in events]),
        "kidnap": _kidnap(events),
        "consistency": _consistency(records),
        "step_ms": _step_ms(records),
    }


def _accuracy(records: Sequence[SequenceRecord]) -> Metrics:
    position, heading, after = _pooled_errors(records)
    p, h = position[after], heading[after]
    return {
        "ape_rmse_m": _rms(position),
        "position_rmse_m": _rms(p),
        "position_mean_m": float(np.mean(p)) if p.size else None,
        "position_median_m": _percentile(p, 50),
        "position_p95_m": _percentile(p, 95),
        "heading_median_deg": _percentile(h, 50),
        "heading_p95_deg": _percentile(h, 95),
        "within": {
            name: float(np.mean(is_within(position, heading, metres, degrees))) if position.size else None
            for name, metres, degrees in WITHIN_TIERS
        },
    }


def _pooled_errors(records: Sequence[SequenceRecord]) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Position errors, heading errors and the mask "after convergence" of all frames with truth."""
    position, heading, after = [np.zeros(0)], [np.zeros(0)], [np.zeros(0, dtype=np.bool_)]
    for record in records:
        p, h, known = record.position_error_m, record.heading_error_deg, record.has_truth
        if p is None or h is None:
            continue
        position.append(p[known])
        heading.append(h[known])
        after.append(_after_convergence(record)[known])
    return np.concatenate(position), np.concatenate(heading), np.concatenate(after)


def _after_convergence(record: SequenceRecord) -> BoolArray:
    first = record.first_converged
    return np.arange(len(record)) >= (len(record) if first is None else first)


def _recognition(records: Sequence[SequenceRecord], places: FloatArray) -> Metrics:
    judged = [r for r in records if r.truth is not None and (r.best_place >= 0).any()] if len(places) else []
    if not judged:
        return {"passed": None, "recognised": None, "rate": None, "wilson95": None}
    seen = [(record.name, *_passes(record, places)) for record in judged]
    passed, recognised = sum(p for _, p, _ in seen), sum(r for _, _, r in seen)
    return {"passed": passed, "recognised": recognised, **_rate((drive, r, p) for drive, p, r in seen)}


def _passes(record: SequenceRecord, places: FloatArray) -> tuple[int, int]:
    from scipy.spatial import KDTree

    assert record.truth is not None
    after = _after_convergence(record) & record.has_truth
    true_xy, reported = record.truth[after, :2], record.best_place[after]
    if not len(true_xy):
        return 0, 0
    nearest, _ = KDTree(places).query(true_xy)
    passed = np.asarray(nearest) <= PASS_RADIUS_M + ROUNDING
    # By distance, not by index: references taken at one spot with several headings are the same place.
    to_reported = np.hypot(*(places[reported] - true_xy).T)
    recognised = passed & (reported >= 0) & (to_reported <= nearest + ROUNDING)
    return int(passed.sum()), int(recognised.sum())


def _global_success(events: Sequence[tuple[str, RunEvents]]) -> Metrics:
    if not events:
        return {"runs": None, "succeeded": None, "rate": None, "wilson95": None}
    succeeded = sum(run.succeeded for _, run in events)
    return {"runs": len(events), "succeeded": succeeded, **_rate((drive, run.succeeded, 1) for drive, run in events)}


def _false_convergence(events: Sequence[tuple[str, RunEvents]]) -> Metrics:
    if not events:
        return {"runs": None, "count": None, "rate": None}
    count = sum(run.falsely_converged for _, run in events)
    return {"runs": len(events), "count": count, "rate": count / len(events)}


def _time_to_converge(records: Sequence[SequenceRecord]) -> Metrics:
    firsts = [(record, record.first_converged) for record in records]
    return {
        "frames_to_converge_median": _median_with_never([None if first is None else first + 1 for _, first in firsts]),
        "seconds_to_converge_median": _median_with_never(
            [None if first is None else float(record.times[first] - record.times[0]) for record, first in firsts]
        ),
    }


def _tracks_lost(events: Sequence[RunEvents]) -> int | None:
    counts = [run.tracks_lost for run in events if run.tracks_lost is not None]
    return sum(counts) if counts else None


def _kidnap(events: Sequence[tuple[str, RunEvents]]) -> Metrics:
    teleports = [(f"{drive} {k}", entry) for drive, run in events for k, entry in enumerate(run.frames_to_recover)]
    frames = [entry for _, entry in teleports]
    if not frames:
        return {"events": None, "recovered": None, "rate": None, "wilson95": None, "frames_to_recover_median": None}
    recovered = sum(entry is not None for entry in frames)
    return {
        "events": len(frames),
        "recovered": recovered,
        **_rate((teleport, entry is not None, 1) for teleport, entry in teleports),
        "frames_to_recover_median": _median_with_never(frames),
    }


def _consistency(records: Sequence[SequenceRecord]) -> Metrics:
    errors, covariances = [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
    for record in (record.judged for record in records):
        if record is None or record.truth is None or record.covariances is None:
            continue
        off = record.poses - record.truth
        off[:, 2] = angle_difference(record.poses[:, 2], record.truth[:, 2])
        errors.append(off[record.converged])
        covariances.append(record.covariances[record.converged])
    return consistency(np.concatenate(errors), np.concatenate(covariances))


def _step_ms(records: Sequence[SequenceRecord]) -> Metrics:
    measured = np.concatenate([record.step_ms for record in records])
    measured = measured[~np.isnan(measured)]
    return {"median": _percentile(measured, 50), "p95": _percentile(measured, 95)}


def _rate(outcomes: Iterable[tuple[str, int, int]]) -> Metrics:
    """Rate and interval of successes of trials; those with the same name are no new ones."""
    of: dict[str, tuple[int, int]] = {}
    for name, hits, trials in outcomes:
        before = of.get(name, (0, 0))
        of[name] = before[0] + hits, before[1] + trials
    successes, tried = (sum(column) for column in zip(*of.values(), strict=True)) if of else (0, 0)
    interval = interval95_over_drives([hits for hits, _ in of.values()], [trials for _, trials in of.values()])
    return {"rate": successes / tried if tried else None, "wilson95": None if interval is None else list(interval)}


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None


def _percentile(values: FloatArray, percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values.size else None


def _median_with_never(values: Sequence[float | None]) -> float | None:
    """Median in which None is later than everything; None when the middle is one of those, or when there are no values."""
    if not values:
        return None
    ordered = sorted(np.inf if value is None else float(value) for value in values)
    middle = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return float(middle) if np.isfinite(middle) else None

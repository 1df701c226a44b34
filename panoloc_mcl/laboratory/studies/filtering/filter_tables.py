"""The tables of the study of the filter.

Definitions are those of ``panoloc_mcl.tools.evaluation``. "After convergence" is from a run's first converged frame on. A kidnap is
*noticed* when "lost" or "searching" is reported at one of its first three images. What the status is worth: a pose is *right* under
0.5 m and 10 degrees and *wrong* above 1 m or 20 degrees; "lost" is justified when the pose is wrong, or at the first three images after
a kidnap.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Number, Rate, Report, Spread
from panoloc_mcl.laboratory.studies.filtering.conditions import CONDITIONS
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate, wilson95
from panoloc_mcl.tools.evaluation.definitions import MIN_FRAMES_TO_END, is_bad, is_good, is_within
from panoloc_mcl.tools.evaluation.events import RunEvents, find_events
from panoloc_mcl.tools.evaluation.tables import BLANK, PAPER_TABLE_2

NOTICED_WITHIN, RECOVERED_WITHIN = 3, 10
WARM_UP = 10
WITHIN_M, WITHIN_DEG = 0.25, 3.0


@dataclass(frozen=True, eq=False)
class Trip:
    """One run, and of which recorded drive each frame is: a spliced trip has pieces of several."""

    record: SequenceRecord
    drives: tuple[str, ...]


Trips = Sequence[Trip]


def tables(title: str, found: Mapping[str, Trips], places: NDArray[np.float64]) -> Report:
    """All that was asked for.

    Parameters
    ----------
    title : str
    found : mapping of str to trips
        By condition.
    places : float64 (P, 2)
        Positions of the references.
    """
    said = "; ".join(f"{name}: {CONDITIONS[name].says}" for name in found)
    counted = "Every rate is over runs, kidnaps or frames; intervals are over drives: seeds count none twice."
    report = Report(f"{title} {counted}\n\n{said}.")
    drives = {name: some for name, some in found.items() if not CONDITIONS[name].kidnapped}
    nothing_known = {name: some for name, some in drives.items() if not name.startswith("kalman")}
    if nothing_known:
        _finding(report, nothing_known)
    if drives:
        _accuracy(report, drives)
    for some in (some for name, some in found.items() if CONDITIONS[name].kidnapped):
        _kidnaps(report, some)
    _status(report, found)
    if "kalman" in found:
        _beside_paper(report, found["kalman"], places)
    return report


def _finding(report: Report, found: Mapping[str, Trips]) -> None:
    heads = ("condition", "group", "drives", "runs", "global success (95 %)", "images to converge: median / p95")
    table = report.table("Finding itself", (*heads, "false convergence (95 %)", "tracks lost", "frames 'lost'"))
    for name, group, some in _parts(found):
        events = _events(some)
        first = [np.inf if trip.record.first_converged is None else trip.record.first_converged + 1.0 for trip in some]
        lost = [status == "lost" for trip in some for status in trip.record.status]
        table.add(
            *(name, group, _drives(some), len(some)),
            Rate.over((drive, event.succeeded) for drive, event in events),
            Spread(first, 0, (0.5, 0.95)),
            Rate.over((drive, event.falsely_converged) for drive, event in events),
            sum(event.tracks_lost or 0 for _, event in events),
            f"{sum(lost)}/{len(lost)}",
        )


_ERRORS = ("position m: median", "p95", "heading degrees: median", "heading p95")


def _errors(figures: Mapping[str, Any]) -> Iterator[Number]:
    """The cells below `_ERRORS`."""
    yield from (Number(figures[name], 4) for name in ("position_median_m", "position_p95_m"))
    yield from (Number(figures[name], 3) for name in ("heading_median_deg", "heading_p95_deg"))


def _accuracy(report: Report, found: Mapping[str, Trips]) -> None:
    tiers = "frames within 0.10 m, 1° / 0.25, 2 / 0.5, 5 / 1, 10, %"
    after = f"after image {WARM_UP} within {WITHIN_M} m, {WITHIN_DEG:.0f}° (95 %)"
    heads = ("condition", "group", "drives", "frames", *_ERRORS, tiers, "after convergence within 0.5 m, 5° (95 %)", after)
    table = report.table("Accuracy", heads)
    for name, group, some in _parts(found):
        figures = evaluate([trip.record for trip in some], None)["overall"]
        table.add(
            *(name, group, _drives(some), figures["frames"], *_errors(figures)),
            " / ".join(f"{100.0 * share:.1f}" for share in figures["within"].values()),
            Rate.over(_within(some, 0.5, 5.0, [trip.record.first_converged for trip in some])),
            Rate.over(_within(some, WITHIN_M, WITHIN_DEG, [WARM_UP] * len(some))),
        )


def _kidnaps(report: Report, found: Trips) -> None:
    heads = ("group", "drives", "kidnaps", f"recovered within {RECOVERED_WITHIN} images (95 %)", "images: median / p95")
    more = (f"noticed within {NOTICED_WITHIN} (95 %)", *_ERRORS, "global success (95 %)", "false convergence (95 %)")
    note = "A kidnap belongs to the drive that the robot was put into, a run to that which it began in."
    table = report.table("Kidnaps", (*heads, *more), note)
    for _, group, some in _parts({"kidnap": found}):
        events = _events(some)
        taken = [pair for trip in some for pair in _recoveries(trip)]
        noticed = [
            (trip.drives[start], bool({"lost", "searching"} & set(trip.record.status[start : start + NOTICED_WITHIN])))
            for trip in some
            for start in np.flatnonzero(trip.record.kidnapped)
        ]
        table.add(
            *(group, _drives(some), len(taken)),
            Rate.over((drive, count <= RECOVERED_WITHIN) for drive, count in taken),
            Spread([count for _, count in taken], 0, (0.5, 0.95)),
            Rate.over(noticed),
            *_errors(evaluate([trip.record for trip in some], None)["overall"]),
            Rate.over((drive, event.succeeded) for drive, event in events),
            Rate.over((drive, event.falsely_converged) for drive, event in events),
        )


def _recoveries(trip: Trip) -> Iterator[tuple[str, float]]:
    """Of every teleport that could be recovered from: the drive that it led into, and the images it took."""
    event = find_events(trip.record)
    starts = np.flatnonzero(trip.record.kidnapped)
    long_enough = starts[np.diff([*starts, len(trip.record)]) >= MIN_FRAMES_TO_END]
    for start, count in zip(long_enough, () if event is None else event.frames_to_recover, strict=True):
        yield trip.drives[start], np.inf if count is None else float(count)


def _status(report: Report, found: Mapping[str, Trips]) -> None:
    heads = ("condition", "group", "'converged': the pose is right", "right poses called 'converged'", "'lost': justified")
    table = report.table(
        "What the status is worth, frame by frame (95 %)", (*heads, "wrong poses after convergence: 'lost'", "not 'converged'")
    )
    for name, group, some in _parts(found):
        drive = [frame for trip in some for frame in trip.drives]
        parts = zip(*(_judged(trip.record) for trip in some), strict=True)
        good, wrong, status, since_kidnap, after = (np.concatenate(part) for part in parts)
        late_enough = wrong & after
        shares = (
            (good, status == "converged"),
            (status == "converged", good),
            (wrong | (since_kidnap < NOTICED_WITHIN), status == "lost"),
            (status == "lost", late_enough),
            (status != "converged", late_enough),
        )
        table.add(name, group, *(Rate.over((drive[k], outcome[k]) for k in np.flatnonzero(of)) for outcome, of in shares))


def _judged(record: SequenceRecord) -> tuple[NDArray[Any], ...]:
    """Of every frame: whether the pose is right, whether it is wrong, the status, images since a kidnap, whether it had converged."""
    position, heading = record.position_error_m, record.heading_error_deg
    assert position is not None
    assert heading is not None
    frames = np.arange(len(record))
    kidnaps = np.maximum.accumulate(np.where(record.kidnapped, frames, -len(frames) - NOTICED_WITHIN))
    first = len(record) if record.first_converged is None else record.first_converged
    return is_good(position, heading), is_bad(position, heading), np.array(record.status), frames - kidnaps, frames >= first


def _beside_paper(report: Report, found: Trips, places: NDArray[np.float64]) -> None:
    heads = ("group", "drives", "recognised/passed, paper (95 %)", "here (95 %)", "runs that lost their track, paper (95 %)")
    table = report.table("The Kalman mode beside the paper", (*heads, "runs that lost it here (95 %)"))
    for _, group, some in _parts({"kalman": found}):
        paper = PAPER_TABLE_2.get(group)
        counts = [(trip.drives[0], evaluate([trip.record], places)["overall"]["recognition"]) for trip in some]
        table.add(
            *(group, _drives(some)),
            BLANK if paper is None else printed(paper.recognised, paper.passed),
            Rate.over((name, k < seen["recognised"]) for name, seen in counts for k in range(seen["passed"] or 0)),
            BLANK if paper is None else printed(paper.tracks_lost, paper.trials),
            Rate.over((drive, (event.tracks_lost or 0) > 0) for drive, event in _events(some)),
        )


def printed(hits: int, trials: int) -> Rate:
    """A rate that the paper prints: its trials are taken as independent."""
    return Rate(hits, trials, trials, wilson95(hits, trials))


def _drives(found: Trips) -> int:
    return len({drive for trip in found for drive in trip.drives})


def _events(found: Trips) -> list[tuple[str, RunEvents]]:
    return [(trip.drives[0], event) for trip in found if (event := find_events(trip.record)) is not None]


def _parts(found: Mapping[str, Trips]) -> Iterator[tuple[str, str, list[Trip]]]:
    for name, some in found.items():
        groups: dict[str, list[Trip]] = defaultdict(list)
        for trip in some:
            groups[trip.record.group].append(trip)
        for group, members in groups.items():
            yield name, group, members


def _within(found: Trips, metres: float, degrees: float, starts: Sequence[int | None]) -> Iterator[tuple[str, bool]]:
    for trip, start in zip(found, starts, strict=True):
        position, heading = trip.record.position_error_m, trip.record.heading_error_deg
        if start is not None and position is not None and heading is not None:
            hits = is_within(position[start:], heading[start:], metres, degrees)
            yield from zip(trip.drives[start:], hits.tolist(), strict=True)

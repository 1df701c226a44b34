"""Single images in a comparison: each by itself, nothing known, no odometry and no filter; and the table of what they say."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.comparison.runs import Answers, Failure, MapCost, Runs, pose_said
from panoloc_mcl.laboratory.comparison.summaries.tables import Entry, Kind, Row
from panoloc_mcl.laboratory.reports import Number, Rate, Report, Spread, Table
from panoloc_mcl.laboratory.timing import one_thread
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_image
from panoloc_mcl.tools.datasets.trajectory import truth_at
from panoloc_mcl.tools.evaluation import SequenceRecord, quantile95_over_drives
from panoloc_mcl.tools.evaluation.tables import BLANK

#: An image is right within so much, and an answer wrong beyond so much.
RIGHT = 0.25, 3.0
WRONG = 1.0, 20.0

COLUMNS: dict[str, Kind] = {
    **dict.fromkeys(("dataset", "light", "corruption", "references", "observation", "drive"), "text"),
    "image": "count",
    **dict.fromkeys(("position_m", "heading_deg", "confidence", "seconds"), "number"),
    "error": "text",
}


def look(drives: Sequence[Drive], panorama_map: PanoramaMap, model: ObservationModel, cost: MapCost) -> Runs:
    """What every image of some drives says by itself; time is that of the processor, on one thread, from pixels to pose."""
    records, answers = [], []
    with one_thread():
        for number, drive in enumerate(drives):
            unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
            if not number:
                # What is imported, compiled or loaded at the first image belongs to none.
                model.observe(unwrap(read_image(drive.files[0])))
            rows = []
            for file in drive.files:
                image = read_image(file)
                begun = time.process_time()
                field = model.observe(unwrap(image))
                spent = time.process_time() - begun
                guess = np.full(3, np.nan) if field.guess is None else field.guess.pose
                poses = unwrap.camera.mounting.base_poses(np.array([pose_said(field), guess]))
                rows.append((poses[0], field.confidence, poses[1], spent))
            *said, seconds = (np.array(part, dtype=np.float64) for part in zip(*rows, strict=True))
            answers.append(Answers(*said))
            records.append(_record(drive, answers[-1].poses, seconds))
    return Runs(tuple(records), panorama_map.references.positions, tuple(answers), cost)


def _record(drive: Drive, poses: FloatArray, seconds: FloatArray) -> SequenceRecord:
    count = len(drive)
    return SequenceRecord(
        name=drive.name,
        run=0,
        times=drive.times,
        poses=np.nan_to_num(poses),
        truth=None if drive.groundtruth is None else truth_at(drive.groundtruth, drive.times),
        status=("searching",) * count,
        best_place=np.full(count, -1, dtype=np.int64),
        step_ms=1000.0 * seconds,
        kidnapped=np.zeros(count, dtype=np.bool_),
    )


def rows_of_images(entries: Sequence[Entry]) -> list[Row]:
    """A row for every image with truth: errors are infinite where it says nothing."""
    rows: list[Row] = []
    for entry in entries:
        axes = {name: value for name, value in {**entry.condition, **entry.method}.items() if name in COLUMNS}
        if isinstance(entry.result, Failure):
            rows.append({**axes, "error": entry.result.text})
            continue
        for record, answers in zip(entry.result.records, entry.result.answers, strict=True):
            if record.truth is None:
                continue
            off = answers.poses - record.truth
            metres, degrees = (
                np.hypot(off[:, 0], off[:, 1]),
                np.degrees(np.abs(angle_difference(answers.poses[:, 2], record.truth[:, 2]))),
            )
            for index in np.flatnonzero(record.has_truth):
                said = bool(np.isfinite(answers.poses[index]).all())
                rows.append(
                    {
                        **axes,
                        "drive": record.name,
                        "image": int(index),
                        "position_m": float(metres[index]) if said else np.inf,
                        "heading_deg": float(degrees[index]) if said else np.inf,
                        "confidence": None if np.isnan(answers.confidence[index]) else float(answers.confidence[index]),
                        "seconds": float(record.step_ms[index]) / 1000.0,
                    }
                )
    return rows


def report_of_images(title: str, entries: Sequence[Entry], rows: Sequence[Row]) -> Report:
    """The short table, methods side by side, and the one with all figures."""
    report = Report(
        f"{title} Every image by itself, position and heading unknown. An image without an answer counts as missed, with an infinite "
        f"error. Right: within {RIGHT[0]:g} m and {RIGHT[1]:g}°; wrong: an answer beyond {WRONG[0]:g} m or {WRONG[1]:g}°. Rates: 95 % "
        "intervals over drives, which are the independent units (medians: bootstrap, of five drives at least). Seconds are those of "
        "the processor, one thread, the map's with the mending of its references' poses."
    )
    parts: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        parts.setdefault((_condition(row), row["observation"]), []).append(row)
    conditions, methods = (list(dict.fromkeys(key[axis] for key in parts)) for axis in (0, 1))
    costs = {
        (_condition({**e.condition, **e.method}), e.method["observation"]): e.result.cost
        for e in entries
        if isinstance(e.result, Runs)
    }
    short = report.table(
        "In short",
        ("condition", "images, drives", *methods),
        "Median / p95 position error, mm; right / images. Bold: most right, of those the smallest median.",
    )
    for condition in conditions:
        mine = {method: parts.get((condition, method), []) for method in methods}
        best = min(methods, key=lambda method: _rank(mine[method]))
        counted = next(some for some in mine.values() if some)
        drives = len({row.get("drive") for row in counted})
        cells = [f"**{_in_short(mine[method])}**" if method == best else _in_short(mine[method]) for method in methods]
        short.add(condition, f"{len(counted)}, {drives}", *cells)
    everything = report.table(
        "All figures",
        ("condition", "method", "images", "drives", "right (95 %)", "wrong answers", "position mm: median / p95 / max", "median's 95 %",
         "heading °: median / p95 / max", "s an image", "s a map", "map MB"),
    )  # fmt: skip
    for (condition, method), part in parts.items():
        _add(everything, condition, method, part, costs.get((condition, method)))
    return report


def _add(table: Table, condition: str, method: str, part: Sequence[Row], cost: MapCost | None) -> None:
    if "position_m" not in part[0]:
        table.add(condition, method, *[BLANK] * 2, part[0]["error"], *[BLANK] * 7)
        return
    metres, degrees = (np.array([row[name] for row in part]) for name in ("position_m", "heading_deg"))
    bounds = quantile95_over_drives(1000.0 * metres, [row["drive"] for row in part])
    table.add(
        condition,
        method,
        len(part),
        len({row["drive"] for row in part}),
        Rate.over((row["drive"], _right(row)) for row in part),
        int(np.sum(np.isfinite(metres) & ((metres > WRONG[0]) | (degrees > WRONG[1])))),
        Spread(1000.0 * metres, 1),
        BLANK if bounds is None else " to ".join(Number(bound, 1).text() for bound in bounds),
        Spread(degrees, 3),
        Number(float(np.median([row["seconds"] for row in part])), 3),
        Number(None if cost is None else cost.seconds, 1),
        Number(None if cost is None else cost.megabytes, 1),
    )


def _right(row: Mapping[str, Any]) -> bool:
    return bool(row["position_m"] <= RIGHT[0] and row["heading_deg"] <= RIGHT[1])


def _condition(row: Mapping[str, Any]) -> str:
    words = [row["dataset"], row["light"]]
    words += [row["corruption"]] if row["corruption"] != "clean" else []
    words += [f"references {row['references']}"] if row["references"] != "all" else []
    return ", ".join(words)


def _rank(part: Sequence[Row]) -> tuple[float, float]:
    """Lower is better: misses, then the median error."""
    if not part or "position_m" not in part[0]:
        return np.inf, np.inf
    return -float(sum(map(_right, part))), float(np.quantile([row["position_m"] for row in part], 0.5, method="inverted_cdf"))


def _in_short(part: Sequence[Row]) -> str:
    if not part or "position_m" not in part[0]:
        return "failed" if part else BLANK
    errors = Spread([1000.0 * row["position_m"] for row in part], 1, (0.5, 0.95))
    return f"{errors.text()}; {sum(map(_right, part))}/{len(part)}"

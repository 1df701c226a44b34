"""The tidy table of a comparison: one row a run, the same to the last byte wherever its cells ran; and what the cells cost."""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from panoloc_mcl.laboratory.comparison.runs import Failure, Runs
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate
from panoloc_mcl.tools.evaluation.definitions import WITHIN_TIERS

Kind = Literal["text", "count", "number"]
Row = dict[str, Any]

#: What a row is of, in the order of the matrix.
CONDITION = ("dataset", "light", "corruption")
METHOD = ("references", "observation", "mode", "variant")

COLUMNS: dict[str, Kind] = {
    **dict.fromkeys((*CONDITION, *METHOD), "text"),
    "seed": "count",
    "sequence": "text",
    "frames": "count",
    "succeeded": "count",
    "sure_but_wrong": "count",
    "tracks_lost": "count",
    "frames_to_converge": "count",
    "seconds_to_converge": "number",
    "passed": "count",
    "recognised": "count",
    "kidnaps": "count",
    "kidnaps_recovered": "count",
    "ape_rmse_m": "number",
    "position_median_m": "number",
    "position_p95_m": "number",
    "heading_median_deg": "number",
    "heading_p95_deg": "number",
    **{f"within_{name}": "number" for name, _, _ in WITHIN_TIERS},
    "error": "text",
}

COST_COLUMNS: dict[str, Kind] = {
    **dict.fromkeys((*CONDITION, *METHOD), "text"),
    "images": "count",
    "ms_median": "number",
    "ms_p95": "number",
}


@dataclass(frozen=True, eq=False)
class Entry:
    """What a comparison knows of one cell.

    Parameters
    ----------
    condition, method : mapping of str to str
        Of `CONDITION` and `METHOD`.
    seed : int or None
    result : Runs or Failure
    """

    condition: Mapping[str, str]
    method: Mapping[str, str]
    seed: int | None
    result: Runs | Failure


def rows_of(entry: Entry) -> list[Row]:
    """The rows of a cell: one a sequence, or one that says why there is none."""
    axes = {**entry.condition, **entry.method, "seed": entry.seed}
    if isinstance(entry.result, Failure):
        return [{**dict.fromkeys(COLUMNS), **axes, "error": entry.result.text}]
    return [{**dict.fromkeys(COLUMNS), **axes, **_figures(record, entry.result.places)} for record in entry.result.records]


def _figures(record: SequenceRecord, places: FloatArray) -> Row:
    overall = evaluate([record], places)["overall"]
    success, wrong, kidnap = overall["global_success"], overall["false_convergence"], overall["kidnap"]
    first = record.first_converged
    return {
        "sequence": record.name,
        "frames": len(record),
        "succeeded": success["succeeded"],
        "sure_but_wrong": wrong["count"],
        "tracks_lost": overall["tracks_lost"],
        "frames_to_converge": None if first is None else first + 1,
        "seconds_to_converge": overall["seconds_to_converge_median"],
        "passed": overall["recognition"]["passed"],
        "recognised": overall["recognition"]["recognised"],
        "kidnaps": kidnap["events"],
        "kidnaps_recovered": kidnap["recovered"],
        **{name: overall[name] for name in COLUMNS if name in overall and name.endswith(("_m", "_deg"))},
        **{f"within_{name}": overall["within"][name] for name, _, _ in WITHIN_TIERS},
    }


def cost_rows(entries: Sequence[Entry]) -> list[Row]:
    """Time of one image from pixels to pose, by condition and method; where cells ran on several machines, of all of them."""
    spent: dict[tuple[str, ...], list[FloatArray]] = {}
    for entry in entries:
        if isinstance(entry.result, Runs):
            key = (*entry.condition.values(), *entry.method.values())
            spent.setdefault(key, []).extend(record.step_ms for record in entry.result.records)
    rows = []
    for key, parts in spent.items():
        ms = np.concatenate(parts)
        ms = ms[~np.isnan(ms)]
        row: Row = dict(zip((*CONDITION, *METHOD), key, strict=True))
        known = len(ms) > 0
        row |= {"images": len(ms), "ms_median": float(np.median(ms)) if known else None}
        rows.append({**row, "ms_p95": float(np.percentile(ms, 95)) if known else None})
    return rows


def csv_text(columns: Mapping[str, Kind], rows: Iterable[Row]) -> str:
    """CSV with a header; numbers as they are to the last digit, empty where a figure does not apply."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        [repr(value) if isinstance(value, float) else "" if value is None else value for value in map(row.get, columns)]
        for row in rows
    )
    return out.getvalue()


def can_write_parquet() -> bool:
    """Whether the library is there; the extra ``compare``."""
    return importlib.util.find_spec("pyarrow") is not None


def parquet_bytes(columns: Mapping[str, Kind], rows: Sequence[Row]) -> bytes:
    """The same table as Parquet, columns typed: text, int64, float64."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {"text": pa.string(), "count": pa.int64(), "number": pa.float64()}
    arrays = [pa.array([row.get(name) for row in rows], type=types[kind]) for name, kind in columns.items()]
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(arrays, names=list(columns)), sink)
    return bytes(sink.getvalue().to_pybytes())

"""What was run, in lines that a reader can take in: shared by the summary and the report."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from panoloc_mcl.tools.evaluation.tables import Table, metrics_table, paper_table

#: Keys of ``run.json`` that are shown, in this order, with what to call them. What is not there is left out.
_SHOWN = {
    "started": "started",
    "dataset": "data set",
    "sequences": "sequences",
    "mode": "mode",
    "initial": "initial pose",
    "model": "observation model",
    "map": "map",
    "seed": "seed",
    "runs": "runs of each sequence",
    "kidnap_every_frames": "kidnapped every (frames)",
    "command": "command",
    "versions": "versions",
    "machine": "machine",
    "threads": "threads",
}

DEFINITIONS = (
    "Errors are unaligned and in the map frame, those after convergence from the first converged frame of a run on; a place "
    "is passed within 0.15 m of it; a run succeeds when it is converged within 0.5 m and 10° to the end or for 10 s.",
    "Sure but wrong: converged with an error above 1.0 m or 20°; lost: such an error for more than 3 s once localised; "
    "recovered: back within 0.5 m and 10° for 10 s; p95: 95 % of the frames are at most that; intervals of rates: 95 %, over drives.",
)


def as_in_the_paper(run_info: Mapping[str, Any]) -> bool:
    """Whether a run may stand beside the paper's Table 2: its tracker, and nobody carries the robot away."""
    return run_info.get("mode") == "kalman_orientation" and not run_info.get("kidnap_every_frames")


def tables_of(metrics: Mapping[str, Any], run_info: Mapping[str, Any]) -> list[Table]:
    """The figures by group, and beside the paper's where a run is like its own."""
    beside = paper_table(metrics) if as_in_the_paper(run_info) else None
    return [metrics_table(metrics), *([] if beside is None else [beside])]


def title_of(run_info: Mapping[str, Any]) -> str:
    """Name of the run, for headings."""
    return str(run_info.get("name") or run_info.get("dataset") or "Localization run")


def facts(run_info: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Pairs of a label and a text, from ``run.json``."""
    return [(label, _shown(key, run_info[key])) for key, label in _SHOWN.items() if run_info.get(key) not in (None, "", [], {})]


def _shown(key: str, value: Any) -> str:
    if key == "command" and isinstance(value, list):
        # As it can be typed again.
        return shlex.join(str(word) for word in value)
    return _text(value)


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_text(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        shown = [_text(entry) for entry in value[:12]]
        more = len(value) - len(shown)
        return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
    return str(value)

"""``report.html``: one file that needs nothing else, on a wide screen or a telephone, dark or light."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation.definitions import GOOD_HEADING_DEG, GOOD_POSITION_M
from panoloc_mcl.tools.evaluation.record import SequenceRecord
from panoloc_mcl.tools.evaluation.tables import metrics_table
from panoloc_mcl.tools.report import figures
from panoloc_mcl.tools.report.facts import DEFINITIONS, facts, tables_of, title_of
from panoloc_mcl.tools.report.highlights import highlights, lead
from panoloc_mcl.tools.report.pages import plotly_script
from panoloc_mcl.tools.report.pages.page import run_data
from panoloc_mcl.tools.report.pages.rendering import source, template
from panoloc_mcl.tools.report.selection import pictured

#: Runs that get pictures; more make the file slow to open.
MOST_PICTURES = 12


@dataclass(frozen=True)
class Picture:
    """The pictures of one run, as ``<svg>`` elements, and how to call it."""

    title: str
    svgs: tuple[str, ...]


def render_report(
    metrics: Mapping[str, Any],
    run_info: Mapping[str, Any],
    records: Sequence[SequenceRecord],
    place_positions: ArrayLike | None,
    folder: Path | None = None,
    place_files: Sequence[str] = (),
) -> str:
    """Text of ``report.html``.

    Parameters
    ----------
    metrics : mapping
        From ``evaluate``.
    run_info : mapping
        As for ``render_summary``.
    records : sequence of SequenceRecord
        Those of the metrics. Pictures show the first run of each sequence, of every group some when there are many.
    place_positions : array_like of float, shape (P, 2), or None
        Map frame, metres.
    folder : Path, optional
        Results folder with the steps and the recorded frames of these runs; without it there are only still pictures.
    place_files : sequence of str, length P, optional
        Images of the places.
    """
    chosen = pictured(records, MOST_PICTURES)
    places = np.zeros((0, 2)) if place_positions is None else np.asarray(place_positions, dtype=np.float64).reshape(-1, 2)
    interactive = folder is not None and plotly_script.can_plot()
    can_draw = figures.can_draw() and not interactive
    data = _data(chosen, places, place_files, folder) if folder is not None and interactive else None
    if data is not None:
        data["graph"] = run_info.get("graph")
    wide = metrics_table(metrics, by="sequences")
    return template("report.html.j2").render(
        title=title_of(run_info),
        lead=lead(run_info, metrics["overall"]),
        highlights=highlights(run_info, metrics["overall"]),
        facts=facts(run_info),
        tables=tables_of(metrics, run_info),
        by_sequence=wide if len(metrics["sequences"]) > 1 else None,
        can_draw=can_draw,
        pictures=[_picture(record, places) for record in chosen] if can_draw else [],
        runs=len(records),
        data=data,
        # Within a page, "</script" would end the data.
        packed=json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        plotly=plotly_script.script() if data else "",
        script=source("report.js"),
        definitions=DEFINITIONS,
    )


def _data(records: Sequence[SequenceRecord], places: FloatArray, place_files: Sequence[str], folder: Path) -> dict[str, Any]:
    """What the page's script is told."""
    runs = [run_data(record, folder) for record in records]
    elevation = next((run["recording"]["elevation_deg"] for run in runs if run["recording"]), [0.0, 0.0])
    return {
        "places": {
            "x": np.round(places[:, 0], 4).tolist(),
            "y": np.round(places[:, 1], 4).tolist(),
            "files": list(place_files) or [""] * len(places),
        },
        "limits": {"position_m": GOOD_POSITION_M, "heading_deg": GOOD_HEADING_DEG},
        "elevation": f"{elevation[0]:g}° (bottom) to {elevation[1]:g}° (top)".replace("-", "−"),
        # Panoramas are shown with equal scales of azimuth and elevation.
        "panorama_ratio": round(360.0 / max(elevation[1] - elevation[0], 1.0), 3),
        "runs": runs,
    }


def _picture(record: SequenceRecord, places: np.ndarray[Any, np.dtype[np.float64]]) -> Picture:
    drawn = (figures.trajectory_svg(record, places), figures.errors_svg(record))
    return Picture(f"{record.name}, run {record.run}", tuple(svg for svg in drawn if svg is not None))

"""What a reader of a report is told first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoloc_mcl.tools.evaluation.tables import number, out_of


def lead(run_info: Mapping[str, Any], overall: Mapping[str, Any]) -> str:
    """What was run, in a sentence."""
    where = f"Data set {run_info['dataset']}" if run_info.get("dataset") else "A drive"
    start = {
        "uniform": "nothing known of the start",
        "known_heading": "heading known at the start",
        "known_pose": "pose known at the start",
    }.get(str(run_info.get("initial")))
    away = run_info.get("kidnap_every_frames")
    parts = [
        f"{where}, {_counted(overall['frames'], 'image')} in {_counted(overall['runs'], 'run')}",
        *([start] if start else []),
        *([f"carried away every {_counted(away, 'image')}, odometry silent"] if away else []),
    ]
    return "; ".join(parts) + "."


def highlights(run_info: Mapping[str, Any], overall: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The figures that are asked for first, as text and what it is of; those that apply."""
    success, kidnap, position = overall["global_success"], overall["kidnap"], overall["position_median_m"]
    until_sure = overall["frames_to_converge_median"]
    found = (
        (out_of(success["succeeded"], success["runs"]), success["rate"], "runs succeeded"),
        # Who knows where it starts need not find itself.
        (number(until_sure, 0), None if run_info.get("initial") == "known_pose" else until_sure, "images until sure, median"),
        (out_of(kidnap["recovered"], kidnap["events"]), kidnap["rate"], "times found back after being carried away"),
        ("" if position is None else metres(position), position, "position error once sure, median"),
        (f"{number(overall['heading_median_deg'], 2)}°", overall["heading_median_deg"], "heading error once sure, median"),
        (f"{number(overall['step_ms']['median'], 0)} ms", overall["step_ms"]["median"], "from pixels to pose, median"),
    )
    return [(text, label) for text, value, label in found if value is not None]


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def metres(value: float) -> str:
    """A length in the unit that it is read best in."""
    if value >= 1.0:
        return f"{value:.2f} m"
    return f"{100.0 * value:.1f} cm" if value >= 0.01 else f"{1000.0 * value:.1f} mm"

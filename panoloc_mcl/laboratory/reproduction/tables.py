"""Tables 1 and 2: light at the places, recognition and lost tracks, beside the paper's."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.comparison.pooling import Group
from panoloc_mcl.laboratory.comparison.study import Study
from panoloc_mcl.laboratory.comparison.summaries.summary import rate
from panoloc_mcl.laboratory.reproduction.methods import LIGHTS, PAPER
from panoloc_mcl.laboratory.studies.light import PAPER_TABLE_1, metered
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.evaluation import wilson95
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M
from panoloc_mcl.tools.evaluation.events import find_events
from panoloc_mcl.tools.evaluation.tables import PAPER_TABLE_2, interval, number, percent


def table_1(dataset: Dataset, lights: Sequence[str], scene: str | None, samples: int, out: Path) -> list[str]:
    """Light at the places beside the paper's."""
    lines = ["## Table 1: light at the reference places, lux", ""]
    measured = lux_of(dataset.path / "lux.csv")
    if not measured and scene is not None:
        positions = dataset.references.poses[:, :2]
        measured = {light: lux for light, (lux, _) in metered(scene, positions, lights, samples).items()}
    lines += ["| light | paper: min / max / mean / sd | here |", "|---|---|---|"]
    rows = []
    for light in lights:
        values = measured.get(light)
        here = "not measured"
        if values is not None:
            found = (values.min(), values.max(), values.mean(), values.std(ddof=1) if len(values) > 1 else 0.0)
            here = " / ".join(f"{value:.1f}" for value in found)
            rows.append([light, *map(repr, map(float, found))])
        lines.append(f"| {light} | {' / '.join(f'{value:g}' for value in PAPER_TABLE_1[light])} | {here} |")
    if not measured:
        lines += ["", f"`{dataset.name}` has no `lux.csv`, and no `--scene` was named: its light was not measured."]
    else:
        write_csv(out / "table_1.csv", ("light", "min", "max", "mean", "sd"), rows)
    return [*lines, ""]


def lux_of(path: Path) -> dict[str, FloatArray]:
    """The columns of ``lux.csv`` that are named like lights; none if there is no such file.

    Raises
    ------
    ConfigError
        A value that is no number.
    """
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    try:
        return {
            light: np.array([float(row[column]) for row in rows])
            for light in LIGHTS
            for column in (rows[0] if rows else {})
            if column.removesuffix("_lux").strip() == light
        }
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}; must hold one number a place and light") from error


def groups_by(found: Study, light: str | None = None) -> dict[tuple[str, str], Group]:
    """Groups of a study by method and corruption."""
    return {
        (group.axes["variant"], group.axes["corruption"]): group
        for group in found.groups
        if light is None or group.axes["light"] == light
    }


def table_2_lines(found: Study, lights: Sequence[str]) -> list[str]:
    """Recognition and lost tracks beside the paper's, and what can be said of the difference."""
    lines = ["## Table 2: recognition under different light", ""]
    lines += [
        "Tracks lost: more than 1 m or 20° off for more than 3 s after having been localised; in brackets those of the heading alone. "
        "The paper, which does not define the term, speaks of the track of the orientation.",
        "",
        "| light | | drives | runs | passed | recognised | % (95 %) | tracks lost | runs succeeded % (95 %) |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for light in lights:
        paper = PAPER_TABLE_2[light]
        lines.append(
            f"| {light} | paper | {paper.trials} | {paper.trials} | {paper.passed} | {paper.recognised} "
            f"| {percent(paper.recognised / paper.passed)} "
            f"({interval(wilson95(paper.recognised, paper.passed))}) | ({paper.tracks_lost}) | – |"
        )
        for (method, _), group in groups_by(found, light).items():
            if group.metrics is None:
                lines.append(f"| {light} | {method} | failed: {group.failures[0]} | | | | | | |")
                continue
            seen = group.metrics["recognition"]
            drives = len({record.name for record in group.records})
            counts = f"{number(seen['passed'], 0)} | {number(seen['recognised'], 0)} | {rate(seen)}"
            success = rate(group.metrics["global_success"])
            lost = f"{number(group.metrics['tracks_lost'], 0)} ({headings_lost(group)})"
            lines.append(f"| {light} | {method} | {drives} | {group.metrics['runs']} | {counts} | {lost} | {success} |")
    return [*lines, "", *pattern(found, lights), *missed(found, lights), ""]


def headings_lost(group: Group) -> int:
    """Tracks lost by the heading alone: as if the position were always right."""
    count = 0
    for record in group.records:
        if record.truth is not None:
            events = find_events(replace(record, poses=np.column_stack([record.truth[:, :2], record.poses[:, 2]])))
            count += 0 if events is None or events.tracks_lost is None else events.tracks_lost
    return count


def pattern(found: Study, lights: Sequence[str]) -> list[str]:
    """Whether the order of the lights is the paper's, and whether rates differ from it beyond chance."""
    lines = []
    shown = {light: groups_by(found, light).get((PAPER, "clean")) for light in lights}
    rated = {light: g.metrics["recognition"] for light, g in shown.items() if g is not None and g.metrics is not None}
    rated = {light: seen for light, seen in rated.items() if seen["passed"]}
    if len(rated) > 1:
        falling = all(a["rate"] >= b["rate"] for a, b in zip(rated.values(), list(rated.values())[1:], strict=False))
        order = " ≥ " if falling else " / "
        text = order.join(f"{light} {percent(seen['rate'])} %" for light, seen in rated.items())
        lines.append(
            f"* `paper` by light: {text}. "
            + ("This is the paper's order." if falling else "The paper's order, noon ≥ afternoon ≥ evening, is not reproduced.")
        )
        bounds_of = [seen["wilson95"] for seen in rated.values()]
        if not falling and max(low for low, _ in bounds_of) <= min(high for _, high in bounds_of):
            lines.append("* The intervals of all lights overlap; what was missed, and for what, by light, stands below.")
    for light, seen in rated.items():
        paper = PAPER_TABLE_2[light]
        bounds = wilson95(paper.recognised, paper.passed)
        assert bounds is not None
        apart = seen["wilson95"][0] > bounds[1] or seen["wilson95"][1] < bounds[0]
        said = "do not overlap: it is another rate" if apart else "overlap: no difference can be told"
        lines.append(
            f"* {light}: the intervals of the paper's rate ({interval(bounds)} %) and of `paper` here "
            f"({interval(seen['wilson95'])} %) {said}."
        )
    return lines


def missed(found: Study, lights: Sequence[str]) -> list[str]:
    """What the passes were taken for that were not recognised: the next place, or one far away; with the heading right or wrong."""
    lines = []
    for light in lights:
        group = groups_by(found, light).get((PAPER, "clean"))
        if group is None or group.metrics is None:
            continue
        places = next(entry.result.places for entry in found.entries if hasattr(entry.result, "places"))
        spacing = float(np.median(np.sort(np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)), axis=1)[:, 1]))
        next_to, far, turned = 0, 0, 0
        for record in group.records:
            first = record.first_converged
            heading = record.heading_error_deg
            if first is None or record.truth is None or heading is None:
                continue
            for frame in range(first, len(record)):
                apart = np.hypot(*(places - record.truth[frame, :2]).T)
                named = record.best_place[frame]
                if apart.min() > PASS_RADIUS_M or named < 0 or apart[named] <= apart.min() + 1e-8:
                    continue
                near = np.hypot(*(places[named] - places[int(np.argmin(apart))])) <= 1.5 * spacing
                next_to, far = next_to + near, far + (not near)
                turned += heading[frame] > 10.0
        total = next_to + far
        if total:
            lines.append(
                f"* {light}: of the {total} passes that `paper` did not recognise, {next_to} were taken for a place next to the right "
                f"one and {far} for one farther away; at {turned} the heading was off by more than 10°."
            )
    return lines


def tracked(found: Study, lights: Sequence[str]) -> list[str]:
    """Accuracy of the same runs, which the paper does not give."""
    lines = [
        "The same runs, after convergence:",
        "",
        "| light | | position mm: median / p95 | heading °: median / p95 | images to converge |",
    ]
    lines.append("|---|---|---|---|---|")
    for light in lights:
        for (method, _), group in groups_by(found, light).items():
            if group.metrics is None:
                continue
            m = group.metrics
            position = [None if m[key] is None else 1000.0 * m[key] for key in ("position_median_m", "position_p95_m")]
            lines.append(
                f"| {light} | {method} | {number(position[0], 1)} / {number(position[1], 1)} | {number(m['heading_median_deg'], 3)} / "
                f"{number(m['heading_p95_deg'], 3)} | {number(m['frames_to_converge_median'], 1)} |"
            )
    return [*lines, ""]


def write_csv(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A small table, whole or not at all."""
    write_atomically(path, "\n".join([",".join(header), *(",".join(row) for row in rows)]) + "\n")

"""Every table and figure of the paper (Steinbauer & Bischof 2004) beside this package's: Markdown, CSV and PNG.

    python scripts/reproduce_paper.py [--dataset PATH_OR_NAME] [--omni PATH] [--scene NAME] [--out DIR] [--workers N]
                                      [--scheduler ADDRESS] [--seeds N] [--figure-seeds N] [--quick]

Three methods stand beside the paper's numbers: its own voting in its own Kalman tracker (configs/paper.yaml), this package's votes in
that tracker (configs/kalman.yaml), both with the heading known at the start, and Monte Carlo localization with nothing known
(configs/global.yaml). Without ``--seeds`` every light gets at least 50 runs and 1000 passes of a place. Cells that are finished are
not run again: an interrupted reproduction goes on. ``--quick`` takes a minute and shows that all of it works, no more.

Table 1 is made of ``lux.csv`` in the data set's folder, if it has one (one row a reference, one column a light); or with ``--scene``
by the simulator's light meter, held at the references in the scene that the data set was rendered from (simulate_hall.yaml: hall).
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import reproduce_figures as figures

from panoloc_mcl.laboratory.comparison.engines import Engine, open_engine
from panoloc_mcl.laboratory.comparison.matrix import FORMAT, matrix_from_mapping
from panoloc_mcl.laboratory.comparison.pooling import Group
from panoloc_mcl.laboratory.comparison.study import Study, compare, plan_of_matrix
from panoloc_mcl.laboratory.comparison.summary import rate
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.settings.validation import read_yaml
from panoloc_mcl.tools.cli.monitor import monitor
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets.splice import group_of
from panoloc_mcl.tools.evaluation import wilson95
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M
from panoloc_mcl.tools.evaluation.events import find_events
from panoloc_mcl.tools.evaluation.tables import PAPER_TABLE_2, interval, number, percent
from panoloc_mcl.tools.runs.pipeline import Monitor

ROOT = Path(__file__).parents[1]
PAPER, KALMAN, MONTE_CARLO = "paper, Kalman", "default, Kalman", "default, Monte Carlo, nothing known"
METHODS = {PAPER: "paper", KALMAN: "kalman", MONTE_CARLO: "global"}
MORE_PIXELS = "paper, Kalman, 3000 pixels"
LIGHTS = tuple(PAPER_TABLE_2)
# Minimum, maximum, mean and standard deviation, lux.
TABLE_1 = {"noon": (335, 1288, 690.9, 248.8), "afternoon": (219, 857, 498.6, 157.9), "evening": (111, 320, 203.7, 63.1)}
PAPER_HZ = 0.8
NOISE = (0.1, 0.25, 0.4, 0.5, 0.6, 0.75)
BARS = (0.1, 0.3, 0.5, 0.7, 0.8, 0.9)
RUNS, PASSES, FIGURE_PASSES = 50, 1000, 225
_GOOD_RATE = 0.9
_METER_HEIGHT_M = 0.02


@dataclass(frozen=True)
class Effort:
    """How much is run.

    Parameters
    ----------
    seeds, figure_seeds : int
        Seeds of Table 2 and of figures 6 and 8.
    noise, bars : tuple of float
    frames : int or None
        Of each sequence.
    sequences : str or list of str
    images : int
        Of figure 4's curve over many images.
    timed : int
        Rounds of the measurement of speed.
    """

    seeds: int
    figure_seeds: int
    noise: tuple[float, ...] = NOISE
    bars: tuple[float, ...] = BARS
    frames: int | None = None
    sequences: str | list[str] = "all"
    images: int = 60
    timed: int = 15


def main(words: Sequence[str] | None = None) -> int:
    """Write the report and print where; 2 if settings or data cannot be used."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--omni", metavar="PATH", help="data set with raw omnidirectional images, for figure 2")
    parser.add_argument("--scene", metavar="NAME", help="scene of the simulator that the data set is of, for table 1")
    parser.add_argument("--out", metavar="DIR", default="results/reproduction", help="folder of the report")
    parser.add_argument("--workers", type=int, metavar="N", help="local worker processes")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask scheduler")
    parser.add_argument("--seeds", type=int, metavar="N", help="seeds of Table 2: each runs every sequence once")
    parser.add_argument("--figure-seeds", type=int, metavar="N", help="seeds of figures 6 and 8")
    parser.add_argument("--quick", action="store_true", help="a few frames and levels: takes a minute, proves nothing")
    arguments = parser.parse_args(words)
    try:
        for name in ("seeds", "figure_seeds"):
            given = getattr(arguments, name)
            if given is not None and given < 1:
                raise ConfigError(f"--{name.replace('_', '-')} {given}: must be at least 1")
        with monitor() as watching, open_engine(arguments.workers, arguments.scheduler) as engine:
            folder = reproduce(arguments, engine, watching)
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    print(folder)
    return 0


def reproduce(arguments: argparse.Namespace, engine: Engine, watching: Monitor) -> Path:
    """Run everything and write the report."""
    dataset = read_dataset(resolve_dataset(arguments.dataset))
    lights = [light for light in LIGHTS if any(group_of(name) == light for name in dataset.sequences)]
    if not lights:
        raise ConfigError(f"--dataset {dataset.name}: has no sequences named {', '.join(LIGHTS)} (as in noon_00)")
    effort = effort_for(dataset, arguments)
    out = Path(arguments.out) / dataset.name
    base = {"dataset": arguments.dataset, "lights": lights, "effort": effort}
    table_2 = study("table_2", base, METHODS, ["clean"], effort.seeds, out, engine, watching)
    noon = {**base, "lights": lights[:1]}
    noise_methods = METHODS | ({} if arguments.quick else {MORE_PIXELS: "paper"})
    noise = study(
        "figure_6", noon, noise_methods, recipes("random_pixels", effort.noise), effort.figure_seeds, out, engine, watching
    )
    bars = study("figure_8", noon, METHODS, recipes("bars", effort.bars), effort.figure_seeds, out, engine, watching)
    bench = figures.Bench(dataset, effort.images)
    lines = [
        *head(dataset, arguments, effort),
        *table_1(dataset, lights, arguments.scene, 64 if arguments.quick else 4096, out),
    ]
    lines += [*table_2_lines(table_2, lights), *tracked(table_2, lights)]
    lines += figures.figure_1(bench, out)
    lines += figures.figure_2(dataset, arguments.omni, out)
    lines += figures.figure_3(bench, lights, out)
    lines += figures.figure_4(bench, lights[0], out)
    lines += figures.pictured(bench, lights[0], "random_pixels:0.5", "Figure 5", "50 % random pixels", out)
    lines += rates("Figure 6: random pixels", noise, "random_pixels", "figure_6.png", out)
    lines += knee(noise, "random_pixels", "The paper: recognition stays high to about 25 % random pixels, with 50 x 1000.")
    lines += figures.pictured(bench, lights[0], "bars:0.7", "Figure 7", "70 % occlusion", out)
    lines += rates("Figure 8: bars", bars, "bars", "figure_8.png", out)
    lines += knee(bars, "bars", "The paper: all recognised to 70 % occlusion.")
    lines += figures.speed(bench, METHODS, ROOT / "configs", PAPER_HZ, effort.timed, lights[0])
    write_atomically(out / "report.md", "\n".join(lines) + "\n")
    return out


def effort_for(dataset: Dataset, arguments: argparse.Namespace) -> Effort:
    """As many seeds as the numbers of runs and passes ask for."""
    if arguments.quick:
        return Effort(arguments.seeds or 1, arguments.figure_seeds or 1, (0.5,), (0.7,), 6, ["*_00"], 3, 2)
    runs, passes = [], []
    for light in LIGHTS:
        drives = [
            drive for name, drive in dataset.sequences.items() if group_of(name) == light and drive.groundtruth is not None
        ]
        if drives:
            runs.append(len(drives))
            passes.append(
                sum(passed(drive.groundtruth.at(drive.times), dataset) for drive in drives if drive.groundtruth is not None)
            )
    # A few passes are over before the robot has converged.
    least = max(0.95 * min(passes, default=1), 1.0)
    seeds = max(-(-RUNS // min(runs, default=1)), int(np.ceil(PASSES / least)))
    figure_seeds = int(np.ceil(FIGURE_PASSES / max(0.95 * (passes or [1])[0], 1.0)))
    return Effort(arguments.seeds or min(seeds, 1000), arguments.figure_seeds or min(figure_seeds, 100))


def passed(poses: FloatArray, dataset: Dataset) -> int:
    """Images of poses (n, 3) that pass a place."""
    apart = np.hypot(*(poses[:, None, :2] - dataset.references.poses[None, :, :2]).transpose(2, 0, 1))
    return int(np.sum(apart.min(axis=1) <= PASS_RADIUS_M))


def recipes(kind: str, shares: Sequence[float]) -> list[str]:
    """The corruptions of a figure, from none on."""
    return ["clean", *(f"{kind}:{share:g}" for share in shares)]


def study(
    name: str,
    base: Mapping[str, Any],
    methods: Mapping[str, str],
    corruptions: list[str],
    seeds: int,
    out: Path,
    engine: Engine,
    watching: Monitor,
) -> Study:
    """One matrix: methods under corruptions and lights."""
    effort: Effort = base["effort"]
    matrix = {
        "format": FORMAT,
        "name": name,
        "datasets": [base["dataset"]],
        "lights": base["lights"],
        "base": {"sequences": effort.sequences},
        "frames": effort.frames,
        "corruptions": corruptions,
        "variants": {method: dict(keys_of(config)) for method, config in methods.items()},
        "seeds": seeds,
    }
    if MORE_PIXELS in methods:
        matrix["variants"][MORE_PIXELS] |= {"observation.paper.pixels": 3000, "observation.paper.trim_to": 2400}
    watching.notice(f"{name}: {seeds} seeds")
    return compare(plan_of_matrix(matrix_from_mapping(matrix, name), name), out, engine, watching, plots=False)


def keys_of(config: str) -> Iterator[tuple[str, Any]]:
    """Dotted keys of a shipped configuration that say what its method is."""

    def flat(prefix: str, node: Any) -> Iterator[tuple[str, Any]]:
        if isinstance(node, dict):
            for key, value in node.items():
                yield from flat(f"{prefix}.{key}", value)
        else:
            yield prefix, node

    data = read_yaml(ROOT / "configs" / f"{config}.yaml")
    for part in ("observation", "localizer"):
        yield from flat(part, data.get(part, {}))


def head(dataset: Dataset, arguments: argparse.Namespace, effort: Effort) -> list[str]:
    """What was run on what."""
    amount = (
        f"Table 2: {effort.seeds} seeds (0 to {effort.seeds - 1}); figures 6 and 8: {effort.figure_seeds} seeds; every seed runs every "
        "sequence once. Rates with Wilson 95 % intervals."
    )
    lines = [f"# The paper on `{dataset.name}`", "", dataset.description, "", amount, ""]
    if arguments.quick:
        lines += ["**Quick: a few images, to see that everything works. These figures prove nothing.**", ""]
    return [
        *lines,
        "Methods: the paper's voting in its Kalman tracker (`configs/paper.yaml`) and this package's votes in the same tracker "
        "(`configs/kalman.yaml`), both with the heading known at the start; Monte Carlo with nothing known (`configs/global.yaml`).",
        "",
    ]


def table_1(dataset: Dataset, lights: Sequence[str], scene: str | None, samples: int, out: Path) -> list[str]:
    """Light at the places beside the paper's."""
    lines = ["## Table 1: light at the reference places, lux", ""]
    measured = lux_of(dataset.path / "lux.csv") or ({} if scene is None else metered(dataset, lights, scene, samples))
    lines += ["| light | paper: min / max / mean / sd | here |", "|---|---|---|"]
    rows = []
    for light in lights:
        values = measured.get(light)
        here = "not measured"
        if values is not None:
            found = (values.min(), values.max(), values.mean(), values.std(ddof=1) if len(values) > 1 else 0.0)
            here = " / ".join(f"{value:.1f}" for value in found)
            rows.append([light, *map(repr, map(float, found))])
        lines.append(f"| {light} | {' / '.join(f'{value:g}' for value in TABLE_1[light])} | {here} |")
    if not measured:
        lines += ["", f"`{dataset.name}` has no `lux.csv`, and no `--scene` was named: its light was not measured."]
    else:
        write_csv(out / "table_1.csv", ("light", "min", "max", "mean", "sd"), rows)
    return [*lines, ""]


def metered(dataset: Dataset, lights: Sequence[str], name: str, samples: int) -> dict[str, FloatArray]:
    """What a light meter on the floor says at the references of a simulated data set, lux.

    Raises
    ------
    PanolocError
        No such scene, a light that it has not, or the renderer is not installed.
    """
    from panoloc_mcl.laboratory.simulation.backend import backend
    from panoloc_mcl.laboratory.simulation.building import build
    from panoloc_mcl.laboratory.simulation.scene import load_scene
    from panoloc_mcl.laboratory.simulation.world import illuminance

    scene, folder = load_scene(name)
    building, used = build(scene, folder), backend()
    if used.remark:
        print(f"note: {used.remark}", file=sys.stderr)
    positions = dataset.references.poses[:, :2]
    points = np.column_stack([positions, np.full(len(positions), _METER_HEIGHT_M)])
    return {light: illuminance(building, light, points, used, samples)[0] for light in lights if light in scene.lights}


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
        "| light | | runs | passed | recognised | % (95 %) | tracks lost | runs succeeded % (95 %) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for light in lights:
        paper = PAPER_TABLE_2[light]
        lines.append(
            f"| {light} | paper | {paper.trials} | {paper.passed} | {paper.recognised} | {percent(paper.recognised / paper.passed)} "
            f"({interval(wilson95(paper.recognised, paper.passed))}) | ({paper.tracks_lost}) | – |"
        )
        for (method, _), group in groups_by(found, light).items():
            if group.metrics is None:
                lines.append(f"| {light} | {method} | failed: {group.failures[0]} | | | | | |")
                continue
            seen = group.metrics["recognition"]
            counts = f"{number(seen['passed'], 0)} | {number(seen['recognised'], 0)} | {rate(seen)}"
            success = rate(group.metrics["global_success"])
            lost = f"{number(group.metrics['tracks_lost'], 0)} ({headings_lost(group)})"
            lines.append(f"| {light} | {method} | {group.metrics['runs']} | {counts} | {lost} | {success} |")
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


def rates(title: str, found: Study, kind: str, file: str, out: Path) -> list[str]:
    """Recognition against severity: table and plot."""
    severities = sorted({severity_of(group.axes["corruption"], kind) for group in found.groups})
    methods = list(dict.fromkeys(group.axes["variant"] for group in found.groups))
    of = {(g.axes["variant"], severity_of(g.axes["corruption"], kind)): g for g in found.groups}
    figures.draw_rates(of, methods, severities, kind, out / file)
    lines = [f"## {title}", "", f"![{title}]({file})", ""]
    lines += [f"| recognised % (95 %) of passed | {' | '.join(f'{100 * s:g} %' for s in severities)} |"]
    lines += [f"|---|{'---|' * len(severities)}"]
    for method in methods:
        cells = []
        for severity in severities:
            group = of[method, severity]
            seen = None if group.metrics is None else group.metrics["recognition"]
            cells.append("–" if seen is None or not seen["passed"] else f"{rate(seen)} of {seen['passed']}")
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return [*lines, ""]


def severity_of(corruption: str, kind: str) -> float:
    """The share in a recipe; 0 for clean."""
    return float(corruption.removeprefix(f"{kind}:")) if corruption != "clean" else 0.0


def knee(found: Study, kind: str, said: str) -> list[str]:
    """Up to where each method recognises nine of ten."""
    lines = [said, ""]
    for method in dict.fromkeys(group.axes["variant"] for group in found.groups):
        good = 0.0
        broken = None
        for severity, group in sorted(
            ((severity_of(g.axes["corruption"], kind), g) for g in found.groups if g.axes["variant"] == method),
            key=lambda pair: pair[0],
        ):
            seen = None if group.metrics is None else group.metrics["recognition"]
            if seen is None or not seen["passed"] or seen["rate"] < _GOOD_RATE:
                broken = severity
                break
            good = severity
        until = f"at least {percent(_GOOD_RATE, 0)} % recognised up to {100 * good:g} %"
        if broken == 0.0:
            until = f"below {percent(_GOOD_RATE, 0)} % already without"
        lines.append(
            f"* {method}: {until}{f', less at {100 * broken:g} %' if broken else '' if broken == 0.0 else ', the most tried'}."
        )
    return [*lines, ""]


def write_csv(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A small table, whole or not at all."""
    write_atomically(path, "\n".join([",".join(header), *(",".join(row) for row in rows)]) + "\n")


if __name__ == "__main__":
    sys.exit(main())

"""Every table and figure of the paper (Steinbauer & Bischof 2004) beside this package's: Markdown, CSV and PNG.

Three methods stand beside the paper's numbers: its own voting in its own Kalman tracker (configs/paper.yaml), this package's votes in
that tracker (configs/kalman.yaml), both with the heading known at the start, and Monte Carlo localization with nothing known
(configs/global.yaml). Cells that are finished are not run again: an interrupted reproduction goes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoloc_mcl.laboratory.comparison.engines import Engine
from panoloc_mcl.laboratory.comparison.matrix import FORMAT, matrix_from_mapping
from panoloc_mcl.laboratory.comparison.study import Study, compare, plan_of_matrix
from panoloc_mcl.laboratory.reproduction import curves, pictures, tables
from panoloc_mcl.laboratory.reproduction.bench import Bench
from panoloc_mcl.laboratory.reproduction.methods import LIGHTS, METHODS, MORE_PIXELS, Effort, effort_for, recipes
from panoloc_mcl.laboratory.reproduction.speed import speed
from panoloc_mcl.laboratory.reproduction.votes import figure_4
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.evaluation.record import group_of
from panoloc_mcl.tools.runs.pipeline import Monitor


@dataclass(frozen=True, eq=False)
class Reproduction:
    """What is run on what, and by whom.

    Parameters
    ----------
    name : str
        Path of the data set, or the name of an embedded one.
    dataset : Dataset
    effort : Effort
    out : Path
    engine : Engine
    monitor : Monitor
    """

    name: str
    dataset: Dataset
    effort: Effort
    out: Path
    engine: Engine
    monitor: Monitor

    def study(
        self, name: str, lights: list[str], methods: Mapping[str, Mapping[str, Any]], corruptions: list[str], seeds: int
    ) -> Study:
        """One matrix: methods under corruptions and lights."""
        matrix = {
            "format": FORMAT,
            "name": name,
            "datasets": [self.name],
            "lights": lights,
            "base": {"sequences": self.effort.sequences},
            "frames": self.effort.frames,
            "corruptions": corruptions,
            "variants": {method: dict(settings) for method, settings in methods.items()},
            "seeds": seeds,
        }
        self.monitor.notice(f"{name}: {seeds} seeds")
        plan = plan_of_matrix(matrix_from_mapping(matrix, name), name)
        return compare(plan, self.out, self.engine, self.monitor, plots=False)


def reproduce(
    name: str,
    out: Path,
    engine: Engine,
    monitor: Monitor,
    *,
    omni: str | None = None,
    scene: str | None = None,
    seeds: int | None = None,
    figure_seeds: int | None = None,
    quick: bool = False,
) -> Path:
    """Run everything and write the report; returns its folder.

    Parameters
    ----------
    name : str
        Path of a data set, or the name of an embedded one.
    out : Path
    engine : Engine
        Where cells run.
    monitor : Monitor
    omni : str, optional
        A data set with raw omnidirectional images, for figure 2; else one named like the first with ``_omni`` behind it.
    scene : str, optional
        The simulator's scene that the data set was rendered from: its light meter gives table 1, where there is no ``lux.csv`` in the
        data set's folder (one row a reference, one column a light).
    seeds, figure_seeds : int, optional
        Of table 2, and of figures 6 and 8. Left out: at least 50 runs and 1000 passes of a place a light.
    quick : bool
        A few images: shows that all of it works, no more.

    Raises
    ------
    ConfigError
        No sequences that are named like the paper's lights.
    """
    dataset = read_dataset(resolve_dataset(name))
    lights = [light for light in LIGHTS if any(group_of(drive) == light for drive in dataset.sequences)]
    if not lights:
        raise ConfigError(f"--dataset {dataset.name}: has no sequences named {', '.join(LIGHTS)} (as in noon_00)")
    effort = effort_for(dataset, seeds, figure_seeds, quick=quick)
    out = out / dataset.name
    run = Reproduction(name, dataset, effort, out, engine, monitor)
    noon, noisy = lights[:1], METHODS if quick else METHODS | MORE_PIXELS
    table_2 = run.study("table_2", lights, METHODS, ["clean"], effort.seeds)
    noise = run.study("figure_6", noon, noisy, recipes("random_pixels", effort.noise), effort.figure_seeds)
    bars = run.study("figure_8", noon, METHODS, recipes("bars", effort.bars), effort.figure_seeds)
    bench = Bench(dataset, effort.images)
    lines = [
        *head(run, quick=quick),
        *tables.table_1(dataset, lights, scene, 64 if quick else 4096, out),
        *tables.table_2_lines(table_2, lights),
        *tables.tracked(table_2, lights),
        *pictures.figure_1(bench, out),
        *pictures.figure_2(dataset, omni, out),
        *pictures.figure_3(bench, lights, out),
        *figure_4(bench, lights[0], out),
        *pictures.pictured(bench, lights[0], "random_pixels:0.5", "Figure 5", "50 % random pixels", out),
        *curves.rates("Figure 6: random pixels", noise, "random_pixels", "figure_6.png", out),
        *curves.knee(noise, "random_pixels", "The paper: recognition stays high to about 25 % random pixels, with 50 x 1000."),
        *pictures.pictured(bench, lights[0], "bars:0.7", "Figure 7", "70 % occlusion", out),
        *curves.rates("Figure 8: bars", bars, "bars", "figure_8.png", out),
        *curves.knee(bars, "bars", "The paper: all recognised to 70 % occlusion."),
        *speed(bench, METHODS, effort.timed, lights[0]),
    ]
    write_atomically(out / "report.md", "\n".join(lines) + "\n")
    return out


def head(run: Reproduction, *, quick: bool) -> list[str]:
    """What was run on what."""
    effort = run.effort
    amount = (
        f"Table 2: {effort.seeds} seeds (0 to {effort.seeds - 1}); figures 6 and 8: {effort.figure_seeds} seeds; every seed runs every "
        "sequence once. Intervals are 95 %, over drives: more seeds over the same images narrow none. The paper's own rates have "
        "Wilson's interval of its counts."
    )
    lines = [f"# The paper on `{run.dataset.name}`", "", run.dataset.description, "", amount, ""]
    if quick:
        lines += ["**Quick: a few images, to see that everything works. These figures prove nothing.**", ""]
    return [
        *lines,
        "Methods: the paper's voting in its Kalman tracker (`configs/paper.yaml`) and this package's votes in the same tracker "
        "(`configs/kalman.yaml`), both with the heading known at the start; Monte Carlo with nothing known (`configs/global.yaml`).",
        "",
    ]

"""A comparison from its sources to its folder: cells that are missing are run, and everything is told of all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from panoloc_mcl.laboratory.comparison.alone import COLUMNS as IMAGE_COLUMNS
from panoloc_mcl.laboratory.comparison.alone import report_of_images, rows_of_images
from panoloc_mcl.laboratory.comparison.cell import Job, forget_data, make_job
from panoloc_mcl.laboratory.comparison.engines import Engine, EngineError, InProcess
from panoloc_mcl.laboratory.comparison.matrix import Cell, Matrix, cells_of_run, expand, is_matrix, matrix_from_mapping
from panoloc_mcl.laboratory.comparison.pooling import Difference, Group, differences, groups_of
from panoloc_mcl.laboratory.comparison.runs import Failure, Runs, read_runs, write_runs
from panoloc_mcl.laboratory.comparison.summaries.plots import can_draw, draw_plots
from panoloc_mcl.laboratory.comparison.summaries.summary import difference_rows, render_summary, versions
from panoloc_mcl.laboratory.comparison.summaries.tables import (
    COLUMNS,
    COST_COLUMNS,
    Entry,
    Row,
    can_write_parquet,
    cost_rows,
    csv_text,
    parquet_bytes,
    rows_of,
)
from panoloc_mcl.robot.errors import ConfigError, ResultsError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.settings.validation import dump_yaml, read_yaml
from panoloc_mcl.tools.config import Override, load_config
from panoloc_mcl.tools.config.overrides import apply, parse_overrides
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.report import read_results
from panoloc_mcl.tools.runs.pipeline import Monitor, SilentMonitor

CELLS = "cells"
TABLE = "table.csv"
PARQUET = "table.parquet"
DIFFERENCES = "differences.csv"
COST = "cost.csv"
SUMMARY = "summary.md"
MATRIX = "matrix.yaml"


@dataclass(frozen=True, eq=False)
class Study:
    """A finished comparison.

    Parameters
    ----------
    folder : Path
        Where it was written; `read_runs` reads what is under ``cells``.
    entries : tuple of Entry
        One a cell, in the order of the matrix.
    rows : list of dict
        The tidy table.
    groups : list of Group
    differences : list of Difference
    summary : str
        Markdown.
    ran : int
        Cells that were run; the others had been finished before.
    """

    folder: Path
    entries: tuple[Entry, ...]
    rows: list[Row]
    groups: list[Group]
    differences: list[Difference]
    summary: str
    ran: int


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be compared.

    Parameters
    ----------
    name, description : str
    cells : tuple of Cell
    datasets : mapping of str to Dataset
        By what the cells' configurations call them.
    finished : tuple of Entry
        Runs of results folders.
    baseline : str or None
    matrices : tuple of Matrix
    """

    name: str
    description: str
    cells: tuple[Cell, ...]
    datasets: Mapping[str, Dataset]
    finished: tuple[Entry, ...] = ()
    baseline: str | None = None
    matrices: tuple[Matrix, ...] = ()


def compare(plan: Plan, out: Path, engine: Engine | None = None, monitor: Monitor | None = None, plots: bool = True) -> Study:
    """Run the cells that have not been run before, and write tables, summary and plots.

    Parameters
    ----------
    plan : Plan
    out : Path
        Results stand in ``out/NAME``; finished cells in ``cells`` below it, and are found there again.
    engine : Engine, optional
        In this process if left out.
    monitor : Monitor, optional
    plots : bool
        Whether to draw; needs the extra ``plot``, and tells the monitor if it is not there.

    Raises
    ------
    PanolocError
        Anything that the user can mend; finished cells are kept.
    """
    monitor = monitor or SilentMonitor()
    folder = Path(out) / plan.name
    jobs = [make_job(cell, plan.datasets[cell.config.dataset]) for cell in plan.cells]
    results, ran = _results(jobs, folder / CELLS, engine or InProcess(), monitor)
    entries = (
        *(Entry(job.cell.condition, job.cell.method, job.cell.seed, results[job.key]) for job in jobs),
        *plan.finished,
    )
    if plan.cells and all(cell.alone for cell in plan.cells) and not plan.finished:
        return _of_images(plan, folder, entries, ran)
    rows = [row for entry in entries for row in rows_of(entry)]
    groups = groups_of(entries)
    found = differences(groups, rows, plan.baseline)
    costs = cost_rows(entries)
    if plan.matrices:
        write_atomically(folder / MATRIX, "---\n".join(dump_yaml(matrix.model_dump(mode="json")) for matrix in plan.matrices))
    write_atomically(folder / TABLE, csv_text(COLUMNS, rows))
    if can_write_parquet():
        write_atomically(folder / PARQUET, parquet_bytes(COLUMNS, rows))
    else:
        monitor.notice('no table.parquet: install pyarrow (pip install "panoloc-mcl[compare]"); table.csv holds the same')
    columns, difference_table = difference_rows(found)
    write_atomically(folder / DIFFERENCES, csv_text(columns, difference_table))
    write_atomically(folder / COST, csv_text(COST_COLUMNS, costs))
    drawn: list[str] = []
    if plots and can_draw():
        drawn = draw_plots(folder, groups)
    elif plots:
        monitor.notice('no plots: install matplotlib (pip install "panoloc-mcl[plot]")')
    summary = render_summary(plan.name, plan.description, groups, found, drawn, entries)
    # Last: a folder without it is one of a comparison that did not finish.
    write_atomically(folder / SUMMARY, summary)
    return Study(folder, entries, rows, groups, found, summary, ran)


def _of_images(plan: Plan, folder: Path, entries: tuple[Entry, ...], ran: int) -> Study:
    """Tables of single images."""
    rows = rows_of_images(entries)
    report = report_of_images(plan.description, entries, rows)
    write_atomically(folder / MATRIX, "---\n".join(dump_yaml(matrix.model_dump(mode="json")) for matrix in plan.matrices))
    write_atomically(folder / TABLE, csv_text(IMAGE_COLUMNS, rows))
    summary = f"# {plan.name}\n\n{report.markdown()}\n\n{versions()}\n"
    write_atomically(folder / SUMMARY, summary)
    return Study(folder, entries, rows, [], [], summary, ran)


def _results(jobs: Sequence[Job], cells: Path, engine: Engine, monitor: Monitor) -> tuple[dict[str, Runs | Failure], int]:
    results: dict[str, Runs | Failure] = {}
    missing: dict[str, Job] = {}
    for job in jobs:
        path = cells / f"{job.key}.npz"
        if job.key in results or job.key in missing:
            continue
        if path.is_file():
            try:
                results[job.key] = read_runs(path, job.key)
                continue
            except ResultsError as error:
                monitor.notice(str(error))
        missing[job.key] = job
    total = len(results) + len(missing)
    if results and missing:
        monitor.notice(f"{len(results)} of {total} cells were finished before; {len(missing)} are left")
    if missing:
        for job, result in engine.run(list(missing.values())):
            if isinstance(result, Failure) and result.unfit:
                raise EngineError(f"{result.text} (finished cells are kept)")
            if isinstance(result, Runs):
                write_runs(cells / f"{job.key}.npz", job.key, job.cell.axes, result)
            else:
                monitor.notice(f"cell {' / '.join(str(value) for value in job.cell.axes.values())} failed: {result.text}")
            results[job.key] = result
            monitor.progress(len(results), total, "cells")
    return results, len(missing)


def plan_of_matrix(matrix: Matrix, source: str = "matrix") -> Plan:
    """A plan of one matrix, its data sets read.

    Raises
    ------
    PanolocError
        Data sets that cannot be read, lights that they have not.
    """
    forget_data()
    datasets = _read(matrix.all_datasets)
    cells = expand(matrix, datasets, source)
    return Plan(
        matrix.name, matrix.description, tuple(cells), _as_cells_name_them(cells, datasets), (), matrix.baseline, (matrix,)
    )


def plan_of_sources(sources: Sequence[Path], overrides: Sequence[str | Override] = ()) -> Plan:
    """What is to be compared: matrices, run configurations and results folders, in any mixture.

    Parameters
    ----------
    sources : sequence of Path
    overrides : sequence of str or Override
        ``KEY=VALUE`` for every YAML file: keys of the matrix, or of the run configuration.

    Raises
    ------
    PanolocError
        Anything that can be found out before the first cell runs.
    """
    forget_data()
    labels = _labels(sources)
    cells: list[Cell] = []
    finished: list[Entry] = []
    matrices: list[Matrix] = []
    datasets: dict[str, Dataset] = {}
    parsed = parse_overrides(overrides)
    for source in sources:
        if source.is_dir() or source.name == "latest":
            finished += entries_of_results(source, labels[source])
        elif is_matrix(source):
            data = read_yaml(source)
            for override in parsed:
                apply(data, override)
            matrix = matrix_from_mapping(data, str(source))
            read = _read(matrix.all_datasets)
            more = expand(matrix, read, str(source))
            matrices.append(matrix)
            cells += more
            datasets |= _as_cells_name_them(more, read)
        else:
            config = load_config(source, parsed)
            read = _read([config.dataset])
            more = cells_of_run(config, labels[source], read[config.dataset])
            cells += more
            datasets |= _as_cells_name_them(more, read)
    name = matrices[0].name if len(sources) == len(matrices) == 1 else "_vs_".join(labels.values())[:80]
    description = " ".join(matrix.description for matrix in matrices if matrix.description)
    baseline = next((matrix.baseline for matrix in matrices if matrix.baseline is not None), None)
    return Plan(name, description, tuple(cells), datasets, tuple(finished), baseline, tuple(matrices))


def entries_of_results(path: Path, name: str) -> list[Entry]:
    """The runs of a results folder as a method of a comparison.

    Raises
    ------
    ResultsError
        As `read_results`.
    """
    results = read_results(path)
    info = results.run_info
    method = {
        "references": "all",
        "observation": str(info.get("model", "?")),
        "mode": str(info.get("mode", "?")),
        "variant": name,
    }
    seed = info.get("seed")
    return [
        Entry(
            {"dataset": str(info.get("dataset", "?")), "light": record.group, "corruption": "clean"},
            method,
            seed + record.run if isinstance(seed, int) else record.run,
            Runs((record,), results.place_positions),
        )
        for record in results.records
    ]


def _labels(sources: Sequence[Path]) -> dict[Path, str]:
    """A short name for each source, the same for none."""
    if len(set(sources)) < len(sources):
        raise ConfigError("two of the things to compare are the same; name each once")
    for depth in (1, 2, 3, 8):
        names = {
            source: "_".join((*source.parts[-depth:-1], source.stem if source.is_file() else source.name)) for source in sources
        }
        if len(set(names.values())) == len(sources):
            break
    safe = {source: "".join(c if c.isalnum() or c in "._-" else "_" for c in name) for source, name in names.items()}
    return {source: name.lstrip("._-") or "results" for source, name in safe.items()}


def _read(names: Sequence[str]) -> dict[str, Dataset]:
    return {name: read_dataset(resolve_dataset(name)) for name in names}


def _as_cells_name_them(cells: Sequence[Cell], read: Mapping[str, Dataset]) -> dict[str, Dataset]:
    """Data sets by the paths that the cells' configurations hold."""
    by_path = {str(dataset.path.resolve()): dataset for dataset in read.values()} | dict(read)
    return {cell.config.dataset: by_path[cell.config.dataset] for cell in cells}

"""How much faster a matrix is on local workers than in one process: whole comparisons in turns.

Every round runs the same matrix in fresh folders, in this process and on so many workers, from the start of the workers to the last
table; maps are built before, once. The tables must be the same to the last byte. Time it on a machine that does nothing else.
"""

from __future__ import annotations

import tempfile
import time
from itertools import count
from pathlib import Path

from panoloc_mcl.laboratory.comparison.cell import make_job, prepare
from panoloc_mcl.laboratory.comparison.engines import open_engine
from panoloc_mcl.laboratory.comparison.matrix import FORMAT, matrix_from_mapping
from panoloc_mcl.laboratory.comparison.study import compare, plan_of_matrix
from panoloc_mcl.laboratory.reports import Number, Ratio, Report


def workers(dataset: str, repeats: int, number: int = 2, seeds: int = 8) -> Report:
    """Time of a comparison on so many local workers against one process.

    Raises
    ------
    PanolocError
        The data cannot be used, or Dask is not there.
    """
    data = {
        "format": FORMAT,
        "name": "speed",
        "datasets": [dataset],
        "observations": {
            "votes": {},
            "votes without refinement": {"model": "votes", "votes": {"refinement": {"enabled": False}}},
        },
        "seeds": seeds,
    }
    plan = plan_of_matrix(matrix_from_mapping(data))
    for job in [make_job(cell, plan.datasets[cell.config.dataset]) for cell in plan.cells][::seeds]:
        prepare(job)
    spent: dict[int | None, list[float]] = {None: [], number: []}
    tables, folders = set(), count()
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(repeats):
            for engines, times in spent.items():
                begin = time.perf_counter()
                with open_engine(engines) as engine:
                    study = compare(plan, Path(folder) / str(next(folders)), engine, plots=False)
                    # What the workers take to stop is over when the tables stand.
                    times.append(time.perf_counter() - begin)
                tables.add((study.folder / "table.csv").read_bytes())
    alike = "the same to the last byte" if len(tables) == 1 else "DIFFERENT"
    name = next(iter(plan.datasets.values())).name
    title = f"{len(plan.cells)} cells of `{name}`, {repeats} rounds in turns. Tables: {alike}."
    report = Report(title, facts={"same": len(tables) == 1})
    table = report.table("", ("engine", "seconds", "times as fast (95 %)"))
    for engines, times in spent.items():
        label = "one process" if engines is None else f"{engines} local workers"
        table.add(label, Number(sorted(times)[len(times) // 2], 1), Ratio.of(spent[None], times))
    return report

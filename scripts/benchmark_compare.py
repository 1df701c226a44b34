"""How much faster a matrix is on local workers than in one process: whole comparisons in turns. Prints Markdown.

    python scripts/benchmark_compare.py [--dataset PATH_OR_NAME] [--workers N] [--seeds N] [--repeats N]

Every round runs the same matrix in fresh folders, in this process and on so many workers, from the start of the workers to the last
table; maps are built before, once. The tables must be the same to the last byte. Time it on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.comparison.cell import make_job, prepare
from panoloc_mcl.laboratory.comparison.engines import open_engine
from panoloc_mcl.laboratory.comparison.matrix import FORMAT, matrix_from_mapping
from panoloc_mcl.laboratory.comparison.study import compare, plan_of_matrix
from panoloc_mcl.robot.errors import PanolocError


def main(words: Sequence[str] | None = None) -> int:
    """Print the table; 2 if the data cannot be used or Dask is not there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument("--seeds", type=int, default=8, metavar="N", help="more make the matrix longer")
    parser.add_argument("--repeats", type=int, default=3, metavar="N")
    arguments = parser.parse_args(words)
    data = {
        "format": FORMAT,
        "name": "speed",
        "datasets": [arguments.dataset],
        "observations": {
            "votes": {},
            "votes without refinement": {"model": "votes", "votes": {"refinement": {"enabled": False}}},
        },
        "seeds": arguments.seeds,
    }
    spent: dict[str, list[float]] = {"here": [], "workers": []}
    tables = set()
    try:
        plan = plan_of_matrix(matrix_from_mapping(data))
        for job in [make_job(cell, plan.datasets[cell.config.dataset]) for cell in plan.cells][:: arguments.seeds]:
            prepare(job)
        with tempfile.TemporaryDirectory() as folder:
            for repeat in range(arguments.repeats):
                for name, workers in (("here", None), ("workers", arguments.workers)):
                    begin = time.perf_counter()
                    with open_engine(workers) as engine:
                        study = compare(plan, Path(folder) / f"{name}_{repeat}", engine, plots=False)
                        # What the workers take to stop is over when the tables stand.
                        spent[name].append(time.perf_counter() - begin)
                    tables.add((study.folder / "table.csv").read_bytes())
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    ratios = np.array(spent["here"]) / np.array(spent["workers"])
    print(f"{len(plan.cells)} cells of `{next(iter(plan.datasets.values())).name}`, {arguments.repeats} rounds.\n")
    print("| engine | seconds, median | times as fast |\n|---|---|---|")
    print(f"| one process | {np.median(spent['here']):.1f} | 1.00 |")
    rounds = ", ".join(f"{ratio:.2f}" for ratio in ratios)
    print(
        f"| {arguments.workers} local workers | {np.median(spent['workers']):.1f} | {np.median(ratios):.2f} (rounds: {rounds}) |"
    )
    print(f"\nTables: {'the same to the last byte' if len(tables) == 1 else 'DIFFERENT'}.")
    return 0 if len(tables) == 1 else 1


if __name__ == "__main__":
    sys.exit(main())

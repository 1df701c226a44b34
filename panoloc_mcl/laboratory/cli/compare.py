"""``panoloc compare``: run a matrix, or several configurations, side by side."""

from __future__ import annotations

import argparse

from panoloc_mcl.tools.cli.command import Command, add_set_option, overrides_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG..., ``--set``, ``--out``, ``--workers``, ``--scheduler``, ``--no-plots``."""
    parser.add_argument(
        "configs",
        nargs="+",
        metavar="CONFIG",
        help="a matrix such as configs/compare_modes.yaml, configurations of runs, or results folders, in any mixture",
    )
    add_set_option(parser)
    parser.add_argument("--out", metavar="DIR", default="results/compare", help="folder the results are made in")
    parser.add_argument("--workers", type=int, metavar="N", help="run cells in N local worker processes (extra 'distributed')")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run cells on the workers of a running Dask scheduler")
    parser.add_argument("--no-plots", action="store_true", help="tables and summary only")


def execute(args: argparse.Namespace) -> int:
    """Run what has not been run before, print the summary, and last the path of its folder."""
    from pathlib import Path

    from panoloc_mcl.laboratory.comparison.engines import open_engine
    from panoloc_mcl.laboratory.comparison.study import compare, plan_of_sources
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        plan = plan_of_sources([Path(config) for config in args.configs], overrides_of(args))
        with open_engine(args.workers, args.scheduler) as engine:
            study = compare(plan, Path(args.out), engine, watching, plots=not args.no_plots)
    print(study.summary)
    print(study.folder)
    return 0


COMMAND = Command(
    "compare", "run a matrix or several configurations side by side: one table, plots", add_arguments, execute, goes_on=True
)

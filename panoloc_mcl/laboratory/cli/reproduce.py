"""``panoloc reproduce``: every table and figure of the paper beside this package's."""

from __future__ import annotations

import argparse

from panoloc_mcl.laboratory.cli.reporting import at_least
from panoloc_mcl.tools.cli.command import Command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Data, where the report goes, who works, and how much."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument("--omni", metavar="DATASET", help="data set with raw omnidirectional images, for figure 2")
    parser.add_argument(
        "--scene", metavar="NAME", help="scene of the simulator that the data set is of: its light meter gives table 1"
    )
    parser.add_argument("--out", metavar="DIR", default="results/reproduction", help="folder of the report")
    parser.add_argument("--workers", type=at_least(1), metavar="N", help="local worker processes")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask scheduler")
    parser.add_argument("--seeds", type=at_least(1), metavar="N", help="seeds of table 2: each runs every sequence once")
    parser.add_argument("--figure-seeds", type=at_least(1), metavar="N", help="seeds of figures 6 and 8")
    parser.add_argument("--quick", action="store_true", help="a few frames and levels: takes a minute, proves nothing")


def execute(args: argparse.Namespace) -> int:
    """Run what has not been run before, write the report, and print its folder last."""
    from pathlib import Path

    from panoloc_mcl.laboratory.comparison.engines import open_engine
    from panoloc_mcl.laboratory.reproduction.reproduce import reproduce
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching, open_engine(args.workers, args.scheduler) as engine:
        folder = reproduce(
            args.dataset,
            Path(args.out),
            engine,
            watching,
            omni=args.omni,
            scene=args.scene,
            seeds=args.seeds,
            figure_seeds=args.figure_seeds,
            quick=args.quick,
        )
    print(folder)
    return 0


COMMAND = Command("reproduce", "every table and figure of the paper beside this package's", add_arguments, execute)

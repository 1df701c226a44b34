"""``panoloc study consistency``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--rows``, ``--also``, ``--drives``, ``--surveys``, ``--seed``."""
    add_data_options(parser)
    parser.add_argument("--rows", nargs="+", default=["*"], metavar="NAME", help="conditions, or patterns of their names")
    parser.add_argument("--also", nargs="+", default=[], metavar="DATASET", help="other data sets, taken as they are")
    parser.add_argument(
        "--drives",
        type=at_least(1),
        metavar="N",
        help="so many drives at most, evenly over all, where lights have no rows of their own",
    )
    parser.add_argument(
        "--surveys",
        type=at_least(1),
        default=4,
        metavar="N",
        help="so many surveys are drawn where poses of references are off, with the drives spread over them (default: 4)",
    )
    parser.add_argument(
        "--seed", type=at_least(0), default=0, metavar="N", help="of the map, of what is disturbed, and of the filter"
    )


def execute(args: argparse.Namespace) -> Report:
    """Localize under every condition."""
    from panoloc_mcl.laboratory.studies.consistency import study
    from panoloc_mcl.tools.cli.monitor import monitor

    # What was interrupted goes on.
    cells = None if args.out is None else Path(args.out) / "cells"
    with monitor() as watching:
        asked = args.every, args.rows, watching.progress, args.keep, args.also, args.drives, cells, args.surveys
        return study(config_of(args, seed=args.seed), *asked)


COMMAND = Reporting(
    "consistency", "whether claimed covariances hold, condition by condition", add_arguments, execute, goes_on=True
)

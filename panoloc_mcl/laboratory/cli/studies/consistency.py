"""``panoloc study consistency``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--rows``, ``--seed``."""
    add_data_options(parser)
    parser.add_argument("--rows", nargs="+", default=["*"], metavar="NAME", help="conditions, or patterns of their names")
    parser.add_argument(
        "--seed", type=at_least(0), default=0, metavar="N", help="of the map, of what is disturbed, and of the filter"
    )


def execute(args: argparse.Namespace) -> Report:
    """Localize under every condition."""
    from panoloc_mcl.laboratory.studies.consistency import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(config_of(args, seed=args.seed), args.every, args.rows, watching.progress, args.keep)


COMMAND = Reporting("consistency", "whether claimed covariances hold, condition by condition", add_arguments, execute)

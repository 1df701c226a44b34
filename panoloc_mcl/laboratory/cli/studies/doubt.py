"""``panoloc study doubt``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--drives``, ``--foreign``, ``--seed``."""
    add_data_options(parser)
    parser.add_argument("--drives", type=at_least(1), metavar="N", help="so many drives at most, evenly over all")
    parser.add_argument(
        "--foreign", metavar="DATASET", help="another data set: its drives in this map, and the other way round"
    )
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="of the maps and of the filter")


def execute(args: argparse.Namespace) -> Report:
    """Drive where nobody can know."""
    from panoloc_mcl.laboratory.studies.robustness.doubt import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(config_of(args, seed=args.seed), args.every, args.drives, args.foreign, watching.progress)


COMMAND = Reporting(
    "doubt", "maps that cannot tell, robots beyond the map, blind streams; is it ever sure and wrong", add_arguments, execute
)

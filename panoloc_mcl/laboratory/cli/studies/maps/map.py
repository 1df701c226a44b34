"""``panoloc study map``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--rows``, ``--seeds``."""
    add_data_options(parser, every=False)
    parser.add_argument(
        "--every", type=at_least(0), default=6, metavar="N", help="localize every N-th image; 0: look at the keyframes only"
    )
    parser.add_argument(
        "--rows",
        nargs="+",
        default=["exact", "2cm", "10cm", "drift", "gross"],
        metavar="ROW",
        help="surveys with errors (exact, 2cm, 10cm, drift, gross); drives:NAME+NAME: a map of drives; update:BASE+LATER: a map of a "
        "drive (or of references) that is brought up to date with another one",
    )
    parser.add_argument("--seeds", type=at_least(0), nargs="+", default=[0], metavar="N", help="of surveys, and of odometry")


def execute(args: argparse.Namespace) -> Report:
    """Make the maps and localize in them."""
    from panoloc_mcl.laboratory.studies.mapping.study import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(config_of(args), args.rows, args.seeds, args.every, watching.progress, args.keep)


COMMAND = Reporting("map", "how good maps are that mend themselves, are made of drives, and live on", add_arguments, execute)

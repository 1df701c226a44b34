"""``panoloc study camera``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--raw``, ``--rows``, ``--data``, ``--seed``."""
    add_data_options(parser)
    parser.add_argument("--raw", metavar="DATASET", help="a data set of raw mirror images, for the rows that are about them")
    parser.add_argument("--rows", nargs="+", default=["*"], metavar="NAME", help="cases, or patterns of their names")
    parser.add_argument("--data", metavar="DIR", help="keep the data sets that are made, and use those that are there")
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="of what is disturbed, map and filter")


def execute(args: argparse.Namespace) -> Report:
    """Disturb, localize, calibrate, localize again."""
    from panoloc_mcl.laboratory.studies.cameras.camera import study
    from panoloc_mcl.tools.cli.monitor import monitor

    config, folder = config_of(args, seed=args.seed), None if args.data is None else Path(args.data)
    with monitor() as watching:
        return study(config, args.raw, args.every, args.rows, folder, watching.progress, args.keep)


COMMAND = Reporting(
    "camera", "what a wrong description of the camera costs, before and after calibrating", add_arguments, execute
)

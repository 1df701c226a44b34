"""``panoloc study images``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--references``, ``--disturb``, ``--seed``, ``--worst``."""
    add_data_options(parser)
    parser.add_argument(
        "--references",
        default="all",
        metavar="PART",
        help="all; checkerboard: every second of a grid; fourth; every-2m: none nearer to another than 2 m (or any other distance)",
    )
    parser.add_argument(
        "--disturb",
        nargs=2,
        type=float,
        metavar=("CM", "DEG"),
        help="standard deviations of Gaussian errors of the references' x, y (each) and heading",
    )
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="of the map and of the errors of the poses")
    parser.add_argument(
        "--worst", type=at_least(0), default=0, metavar="N", help="also list the N images with the largest errors"
    )


def execute(args: argparse.Namespace) -> Report:
    """Look at every image."""
    from panoloc_mcl.laboratory.studies.images import study
    from panoloc_mcl.tools.cli.monitor import monitor

    disturb = None if args.disturb is None else (args.disturb[0] / 100.0, args.disturb[1])
    with monitor() as watching:
        config = config_of(args, seed=args.seed)
        return study(config, args.every, args.references, disturb, args.worst, watching.progress)


COMMAND = Reporting("images", "what one image tells by itself, position and heading unknown", add_arguments, execute)

"""``panoloc study soak``."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--set``, ``--updates``, ``--minutes``, ``--modes``, ``--anew``, ``--seed``."""
    add_data_options(parser, every=False)
    parser.add_argument("--updates", type=at_least(1), default=1000, metavar="N", help="images in each mode")
    parser.add_argument(
        "--minutes",
        type=float,
        default=math.inf,
        metavar="M",
        help="stop in each mode after so long, with what was done until then; with --out the same command goes on there",
    )
    parser.add_argument(
        "--modes", nargs="+", choices=["monte_carlo", "kalman_orientation"], default=["monte_carlo", "kalman_orientation"]
    )
    parser.add_argument(
        "--anew",
        action="store_true",
        help="compare every image with the map when it comes, and track, as a robot does; several times slower",
    )
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N")


def execute(args: argparse.Namespace) -> Report:
    """Drive with faults."""
    from panoloc_mcl.laboratory.studies.robustness.soak import study
    from panoloc_mcl.tools.cli.monitor import monitor

    # What was stopped goes on.
    kept = None if args.out is None else Path(args.out) / "parts"
    with monitor() as watching:
        asked = args.updates, tuple(args.modes), watching.progress, args.anew, 60.0 * args.minutes, kept
        return study(config_of(args, seed=args.seed), *asked)


COMMAND = Reporting(
    "soak", "hours of driving with random faults, and what must hold after every image", add_arguments, execute, goes_on=True
)

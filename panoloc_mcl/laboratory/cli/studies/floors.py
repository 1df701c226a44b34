"""``panoloc study floors``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least
from panoloc_mcl.tools.cli.command import add_set_option

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``DATASET…``, ``--seeds``, ``--images``, ``--rides``, ``--set``."""
    parser.add_argument("floors", nargs="+", metavar="DATASET", help="one data set for each floor")
    parser.add_argument("--seeds", type=at_least(1), default=10, metavar="N", help="robots")
    parser.add_argument("--images", type=at_least(2), default=10, metavar="N", help="seen on each floor")
    parser.add_argument("--rides", type=at_least(0), default=2, metavar="N", help="between floors")
    add_set_option(parser)


def execute(args: argparse.Namespace) -> Report:
    """Ride."""
    from panoloc_mcl.laboratory.studies.floors import study
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.config import Override, config_from_mapping

    overrides = [Override("dataset", args.floors[0], f"{args.floors[0]}"), *args.overrides]
    config = config_from_mapping({}, "floors", overrides)
    with monitor() as watching:
        return study(config, args.floors, args.seeds, args.images, args.rides, watching.progress)


COMMAND = Reporting(
    "floors", "several maps at once: on which floor is the robot, found from nothing and kept", add_arguments, execute
)

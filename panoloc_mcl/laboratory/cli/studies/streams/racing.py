"""``panoloc study racing``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--seconds``."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set with ground truth, or an embedded one")
    parser.add_argument("--seconds", type=at_least(1), default=600, metavar="S", help="how long threads race")


def execute(args: argparse.Namespace) -> Report:
    """Race."""
    from panoloc_mcl.laboratory.studies.streams.racing import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.dataset, args.seconds, watching.progress)


COMMAND = Reporting(
    "racing",
    "images, odometry, questions and orders from threads of their own, for as long as you like",
    add_arguments,
    execute,
)

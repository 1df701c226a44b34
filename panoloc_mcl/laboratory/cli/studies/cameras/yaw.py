"""``panoloc study yaw``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--references``."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument("--references", type=at_least(1), metavar="N", help="look at so many, evenly over all; all if left out")


def execute(args: argparse.Namespace) -> Report:
    """Turn the camera until the references agree."""
    from panoloc_mcl.laboratory.studies.cameras.yaw import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.dataset, args.references, watching.progress)


COMMAND = Reporting("yaw", "the mount's yaw by the references as they are, mirrored, and turned", add_arguments, execute)

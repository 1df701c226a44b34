"""``panoloc study poses``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--draws``, ``--seed``, ``--within``, ``--threads``."""
    parser.add_argument("--dataset", nargs="+", default=["hall"], metavar="DATASET", help="data sets, or embedded ones by name")
    parser.add_argument("--draws", type=at_least(1), default=10, metavar="N", help="disturbances of each kind")
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N")
    parser.add_argument("--within", type=float, metavar="METRES", help="only references so near to the disturbed ones")
    parser.add_argument("--threads", type=at_least(1), metavar="N", help="all cores if left out")


def execute(args: argparse.Namespace) -> Report:
    """Disturb and judge."""
    from panoloc_mcl.laboratory.studies.poses import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.dataset, args.draws, args.seed, args.within, args.threads, watching.progress)


COMMAND = Reporting(
    "poses", "how many wrong poses of references a map finds, and which right ones it blames", add_arguments, execute
)

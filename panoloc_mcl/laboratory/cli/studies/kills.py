"""``panoloc study kills``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--kills``, ``--seed``."""
    parser.add_argument("--kills", type=at_least(1), default=200, metavar="N", help="over all commands")
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="of the moments")


def execute(args: argparse.Namespace) -> Report:
    """Kill and look."""
    from panoloc_mcl.laboratory.studies.robustness.kills import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.kills, args.seed, progress=watching.progress)


COMMAND = Reporting("kills", "kill commands at random moments; are files whole, does a restart finish", add_arguments, execute)

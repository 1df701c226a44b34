"""``panoloc study mount``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--metres``."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument("--metres", type=float, default=5.0, metavar="METRES", help="length of a stretch (default: 5)")


def execute(args: argparse.Namespace) -> Report:
    """Place the camera by every stretch."""
    from panoloc_mcl.laboratory.studies.cameras.mount import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.dataset, args.metres, watching.progress)


COMMAND = Reporting("mount", "how well one short drive tells where the camera sits on the base", add_arguments, execute)

"""``panoloc study colmap``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--drives``."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument(
        "--drives", nargs="+", default=["all"], metavar="NAME", help="drives, or patterns of them; all if left out"
    )


def execute(args: argparse.Namespace) -> Report:
    """Map the drives."""
    from panoloc_mcl.laboratory.studies.mapping.colmap import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.dataset, args.drives, watching.progress)


COMMAND = Reporting(
    "colmap", "how good COLMAP's map of a drive is, by images alone (needs the extra peers)", add_arguments, execute
)

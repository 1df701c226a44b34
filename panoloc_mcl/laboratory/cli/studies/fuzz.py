"""``panoloc study fuzz``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``FILE...``, ``--inputs``, ``--kinds``, ``--seed``."""
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="FILE", help="calibration files of other tools, to be damaged, too"
    )
    parser.add_argument("--inputs", type=at_least(1), default=2000, metavar="N", help="damaged files, over all kinds")
    parser.add_argument(
        "--kinds",
        nargs="+",
        default=["*"],
        metavar="NAME",
        help="these kinds only, or patterns of them; their inputs stay the same",
    )
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N")


def execute(args: argparse.Namespace) -> Report:
    """Damage and read."""
    from panoloc_mcl.laboratory.studies.robustness.fuzz import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.inputs, args.seed, args.files, watching.progress, args.kinds)


COMMAND = Reporting("fuzz", "damaged files of every kind; are they read, or refused in a line", add_arguments, execute)

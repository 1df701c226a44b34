"""``panoloc study light``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--scene``, ``--samples``."""
    parser.add_argument("--scene", default="hall", metavar="NAME", help="a shipped scene, or a file")
    parser.add_argument("--samples", type=at_least(1), default=4096, metavar="N", help="light paths to each place")


def execute(args: argparse.Namespace) -> Report:
    """Measure."""
    from panoloc_mcl.laboratory.studies.light import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(args.scene, args.samples, watching.notice)


COMMAND = Reporting("light", "the light at the places of a simulated scene, beside the paper's Table 1", add_arguments, execute)

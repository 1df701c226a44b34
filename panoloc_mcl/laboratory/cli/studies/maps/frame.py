"""``panoloc study frame``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, at_least, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--set``, ``--surveys``."""
    add_data_options(parser, every=False)
    parser.add_argument("--surveys", type=at_least(1), default=120, metavar="N", help="of each kind of error (default: 120)")


def execute(args: argparse.Namespace) -> Report:
    """Draw surveys and mend them."""
    from panoloc_mcl.laboratory.studies.mapping.frame import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(config_of(args), args.surveys, watching.progress)


COMMAND = Reporting("frame", "whether a mended map knows how far its frame is off", add_arguments, execute)

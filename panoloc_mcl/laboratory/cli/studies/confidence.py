"""``panoloc study confidence``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, add_processes_option, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report

CONDITIONS = ("clean", "bars:0.7", "random_pixels:0.5", "bars:0.5+random_pixels:0.25", "spatial_light", "tilt:2", "tilt:4")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--every``, ``--set``, ``--foreign``, ``--conditions``, ``--processes``."""
    add_data_options(parser)
    parser.add_argument("--foreign", metavar="DATASET", help="a data set whose images fit nowhere in the first one's map")
    parser.add_argument("--conditions", nargs="+", default=CONDITIONS, metavar="NAME", help="corruptions, or clean")
    add_processes_option(parser, "conditions")


def execute(args: argparse.Namespace) -> Report:
    """Judge every image under every condition."""
    from panoloc_mcl.laboratory.studies.confidence import study
    from panoloc_mcl.tools.cli.monitor import monitor

    with monitor() as watching:
        return study(config_of(args), args.conditions, args.foreign, args.every, args.processes, watching.progress)


COMMAND = Reporting(
    "confidence",
    "whether a map's confidence is calibrated, and whether images of elsewhere are recognised as such",
    add_arguments,
    execute,
)

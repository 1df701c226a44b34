"""``panoloc study filter``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, add_processes_option, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--set``, ``--conditions``, ``--foreign``, ``--seeds``, ``--frames``, ``--processes``."""
    add_data_options(parser, every=False)
    parser.add_argument(
        "--conditions",
        nargs="+",
        default=["plain"],
        metavar="NAME",
        help="plain, kidnap, foreign, drop, noisy_odometry, late, image_only, no_virtual_places, kalman, kalman_30, …; or all",
    )
    parser.add_argument("--foreign", metavar="DATASET", help="where the condition foreign takes its images from; same camera")
    parser.add_argument("--seeds", type=at_least(1), default=20, metavar="N", help="runs over every sequence, seeds 0 to N - 1")
    parser.add_argument("--frames", type=at_least(1), metavar="N", help="only the first N images of every sequence")
    add_processes_option(parser, "groups of sequences")


def execute(args: argparse.Namespace) -> Report:
    """Run everything and make the tables."""
    from panoloc_mcl.laboratory.studies.filtering.conditions import chosen
    from panoloc_mcl.laboratory.studies.filtering.filter import study
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.config import Override

    conditions = chosen(args.conditions, args.foreign is not None)
    overrides = [Override("dataset", args.dataset, f"--dataset {args.dataset}"), *args.overrides]
    with monitor() as watching:
        return study(conditions, overrides, args.foreign, args.seeds, args.frames, args.processes, watching.progress)


COMMAND = Reporting("filter", "what the filter does when all goes well and when it does not", add_arguments, execute)

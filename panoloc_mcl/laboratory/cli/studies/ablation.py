"""``panoloc study ablation``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report

CONDITIONS = (
    *("clean", "bars:0.7", "random_pixels:0.5", "bars:0.5+random_pixels:0.25", "spatial_light"),
    *("tilt:2", "tilt:4", "blur:2", "gain:0.35", "gain:2.2"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--models``, ``--switches``, ``--conditions``, ``--every``, ``--seed``."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument("--models", nargs="+", default=["*"], metavar="NAME", help="observation models, or patterns of them")
    parser.add_argument(
        "--switches", nargs="+", default=["*"], metavar="NAME", help="what is changed of them, or patterns; none: as they are"
    )
    parser.add_argument("--conditions", nargs="+", default=CONDITIONS, metavar="NAME", help="corruptions, or clean")
    parser.add_argument("--every", type=at_least(1), default=1, metavar="N", help="use every N-th image of a sequence")
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="of corruptions and models that draw pixels")


def execute(args: argparse.Namespace) -> Report:
    """Make the tables; with ``--out`` they are written after every model."""
    from panoloc_mcl.laboratory.studies.ablation import selected, study
    from panoloc_mcl.tools.cli.monitor import monitor

    models = selected(args.models, args.switches)
    with monitor() as watching:
        return study(args.dataset, models, args.conditions, args.every, args.seed, watching.progress, args.keep)


COMMAND = Reporting(
    "ablation", "every observation model and switch, light and corruption, over single images", add_arguments, execute
)

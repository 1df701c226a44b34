"""``panoloc study layouts``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, add_data_options, config_of

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--dataset``, ``--set``, ``--layouts``, ``--leave``."""
    add_data_options(parser, every=False)
    parser.add_argument("--layouts", nargs="+", metavar="NAME", help="such as ros1, mcap-zstd, cold, video; all if left out")
    parser.add_argument("--leave", type=Path, metavar="DIR", help="leave what was written, and the results, in this folder")


def execute(args: argparse.Namespace) -> Report:
    """Write, read, run."""
    from panoloc_mcl.laboratory.layouts import LAYOUTS
    from panoloc_mcl.laboratory.studies.streams.layouts import study
    from panoloc_mcl.robot.errors import ConfigError, did_you_mean
    from panoloc_mcl.tools.cli.monitor import monitor

    names = args.layouts or list(LAYOUTS)
    for name in names:
        if name not in LAYOUTS:
            raise ConfigError(
                f"--layouts {name}: no such layout; {did_you_mean(name, LAYOUTS) or 'there are ' + ', '.join(LAYOUTS)}"
            )
    with monitor() as watching:
        return study(config_of(args), names, args.leave, watching.progress)


COMMAND = Reporting(
    "layouts", "drives written as bags, MCAP, COLD and videos: are the poses those of the original?", add_arguments, execute
)

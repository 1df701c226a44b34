"""``panoloc simulate``: render a data set from a scene."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.tools.cli.command import Command, add_set_option

if TYPE_CHECKING:
    from panoloc_mcl.tools.config import Override


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG, ``-o``, ``--set``."""
    parser.add_argument("config", metavar="CONFIG", help="configuration of the simulation, such as configs/simulate_hall.yaml")
    parser.add_argument(
        "-o", "--output", metavar="DATASET", required=True, help="folder of the data set; a run that was stopped goes on there"
    )
    add_set_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Render, and print the folder last."""
    from panoloc_mcl.laboratory.simulation.settings import load_simulation
    from panoloc_mcl.laboratory.simulation.simulate import Simulation
    from panoloc_mcl.tools.cli.monitor import monitor

    path = Path(args.config)
    simulation = Simulation(load_simulation(path, list(args.overrides)), path.parent)
    with monitor() as watching:
        simulation.run(Path(args.output), watching.progress, watching.notice)
    print(args.output)
    return 0


def simulation_faults(path: Path, overrides: list[str | Override]) -> list[str]:
    """What would stop ``panoloc simulate`` before its first frame; needs no renderer."""
    from panoloc_mcl.laboratory.simulation.settings import load_simulation
    from panoloc_mcl.laboratory.simulation.simulate import Simulation

    try:
        Simulation(load_simulation(path, overrides), path.parent)
    except PanolocError as error:
        return list(error.faults)
    return []


COMMAND = Command("simulate", "render a data set from a scene (needs the extra simulate)", add_arguments, execute, goes_on=True)

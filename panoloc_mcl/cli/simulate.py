"""``panoloc simulate``: render a data set from a scene."""

from __future__ import annotations

import argparse

from panoloc_mcl.cli.command import Command, add_set_option


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG, ``-o``, ``--set``."""
    parser.add_argument("config", metavar="CONFIG", help="configuration of the simulation, such as configs/simulate_hall.yaml")
    parser.add_argument(
        "-o", "--output", metavar="DATASET", required=True, help="folder of the data set; a run that was stopped goes on there"
    )
    add_set_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Render, and print the folder last."""
    from pathlib import Path

    from panoloc_mcl.cli.monitor import monitor
    from panoloc_mcl.simulation.settings import load_simulation
    from panoloc_mcl.simulation.simulate import Simulation

    path = Path(args.config)
    simulation = Simulation(load_simulation(path, list(args.overrides)), path.parent)
    with monitor() as watching:
        simulation.run(Path(args.output), watching.progress, watching.notice)
    print(args.output)
    return 0


COMMAND = Command("simulate", "render a data set from a scene (needs the extra simulate)", add_arguments, execute)

"""``panoloc run``: localize over a data set and write a results folder."""

from __future__ import annotations

import argparse

from panoloc_mcl.cli.command import Command, add_set_option, overrides_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG, ``--set``, ``--seed``, ``--out``."""
    parser.add_argument("config", metavar="CONFIG", help="YAML file, such as configs/global.yaml")
    add_set_option(parser)
    parser.add_argument("--seed", type=int, metavar="N", help="seed of everything random")
    parser.add_argument("--out", metavar="DIR", help="folder the results folder is made in")


def execute(args: argparse.Namespace) -> int:
    """Run, print the figures, and last the path of the results folder."""
    from panoloc_mcl.cli.monitor import monitor
    from panoloc_mcl.config import Override, load_config
    from panoloc_mcl.pipeline import run
    from panoloc_mcl.report import print_metrics

    named = [
        Override(key, value, f"--{key} {value}") for key, value in (("seed", args.seed), ("out", args.out)) if value is not None
    ]
    config = load_config(args.config, overrides_of(args, named))
    with monitor() as watching:
        outcome = run(config, args.command_line, watching)
    print_metrics(outcome.metrics, beside_paper=config.localizer.mode == "kalman_orientation")
    print(outcome.folder)
    return 0


COMMAND = Command("run", "localize over a data set's sequences and write a results folder", add_arguments, execute)

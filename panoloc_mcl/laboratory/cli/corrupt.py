"""``panoloc corrupt``: a data set as it would be had it been recorded less perfectly."""

from __future__ import annotations

import argparse

from panoloc_mcl.tools.cli.command import Command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """DATASET, ``-o``, ``--recipe``, ``--seed``, ``--sequences``."""
    parser.add_argument("dataset", metavar="DATASET", help="folder of a data set, or the name of an embedded one (hall)")
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="folder of the data set to write")
    parser.add_argument(
        "--recipe",
        required=True,
        metavar="NAME",
        help="imperfections with their levels, such as body:strong+jpeg:mild or everything:mild; an unknown name lists all",
    )
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    parser.add_argument(
        "--sequences", nargs="+", default=["all"], metavar="NAME", help="names or globs of the sequences to write (default all)"
    )


def execute(args: argparse.Namespace) -> int:
    """Write the data set, and print its folder."""
    from pathlib import Path

    from panoloc_mcl.laboratory.corruptions import corrupt, parse_recipe
    from panoloc_mcl.robot.errors import ConfigError
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

    if args.seed < 0:
        raise ConfigError(f"--seed {args.seed}: must be 0 or more")
    recipe = parse_recipe(args.recipe)
    dataset = read_dataset(resolve_dataset(args.dataset))
    with monitor() as watching:
        path = corrupt(dataset, recipe, args.seed, Path(args.output), args.sequences, watching.progress)
    print(path)
    return 0


COMMAND = Command("corrupt", "write a data set with the imperfections of real recordings", add_arguments, execute)

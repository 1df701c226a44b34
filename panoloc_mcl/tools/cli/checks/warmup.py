"""``panoloc warmup``: compile every kernel now, so that no run has to."""

from __future__ import annotations

import argparse

from panoloc_mcl.tools.cli.command import Command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


def execute(args: argparse.Namespace) -> int:
    """Call each kernel once on tiny arrays and print how long that took."""
    from time import perf_counter

    from panoloc_mcl.robot.kernels.examples import EXAMPLES, find

    width = max(map(len, EXAMPLES))
    start = perf_counter()
    for name, example in EXAMPLES.items():
        before = perf_counter()
        find(name)(*example())
        print(f"{name:<{width}}  {perf_counter() - before:7.2f} s", flush=True)
    print(f"{'all':<{width}}  {perf_counter() - start:7.2f} s")
    return 0


COMMAND = Command("warmup", "compile every kernel and print the time of each", add_arguments, execute)

"""``panoloc live``: camera or recording in, poses out, until it is stopped."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from types import FrameType
from typing import TYPE_CHECKING

from panoloc_mcl.tools.cli.command import Command, add_set_option, overrides_of
from panoloc_mcl.tools.cli.notices import note

if TYPE_CHECKING:
    from panoloc_mcl.tools.live import Figures

_LINE_EVERY = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG, ``--set``, ``--rate``, ``--record``, ``--foxglove``."""
    parser.add_argument("config", metavar="CONFIG", help="YAML file, such as configs/live.yaml")
    add_set_option(parser)
    parser.add_argument(
        "--rate", type=float, metavar="R", help="how fast a recording is played; 0 = every image, without waiting"
    )
    parser.add_argument("--record", metavar="FILE.mcap", help="record images, odometry and poses")
    parser.add_argument("--foxglove", type=int, nargs="?", const=8765, metavar="PORT", help="serve what Foxglove's app shows")


def execute(args: argparse.Namespace) -> int:
    """Run; one status line on standard error, poses on standard output. Ctrl-C and SIGTERM stop it, the state is saved."""
    from panoloc_mcl.tools.config import Override
    from panoloc_mcl.tools.config.live import load_live_config
    from panoloc_mcl.tools.live.run import run_live

    named = [
        Override(key, value, f"--{word} {value}")
        for key, word, value in (
            ("input.rate", "rate", args.rate),
            ("output.record", "record", args.record),
            ("output.foxglove.port", "foxglove", args.foxglove),
        )
        if value is not None
    ]
    if args.foxglove is not None:
        named.append(Override("output.foxglove.enabled", True, "--foxglove"))
    config = load_live_config(args.config, overrides_of(args, named))
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        figures = run_live(config, stopped, note, _StatusLine().show)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    print(f"\n{line_of(figures)}" if sys.stderr.isatty() else line_of(figures), file=sys.stderr)
    return 0


class _StatusLine:
    """On a terminal one line that changes; elsewhere a line now and then."""

    def __init__(self) -> None:
        self._shown = 0

    def show(self, figures: Figures) -> None:
        """Called about once a second."""
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\x1b[K{line_of(figures)[:150]}")
            sys.stderr.flush()
        elif self._shown % _LINE_EVERY == 0 or "no image " in figures.message:
            print(line_of(figures), file=sys.stderr, flush=True)
        self._shown += 1


def line_of(figures: Figures) -> str:
    """How it goes, in one line."""
    times = f"{figures.latency_ms:.0f} ms latency ({figures.step_ms:.0f} ms work)" if figures.images else "no answer yet"
    text = f"{figures.status}: {figures.images} images, {figures.dropped} dropped, {times}"
    return f"{text}; {figures.message}" if figures.message else text


COMMAND = Command("live", "localize a running robot: camera or recording in, poses out", add_arguments, execute)

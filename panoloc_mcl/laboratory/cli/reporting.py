"""Commands that answer with a report, several under one word: ``panoloc study NAME``, ``panoloc benchmark NAME``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command, add_json_option, add_set_option

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report
    from panoloc_mcl.tools.config import RunConfig


@dataclass(frozen=True)
class Reporting:
    """One word after ``panoloc study`` or ``panoloc benchmark``.

    Parameters
    ----------
    name : str
    summary : str
        One line for the list.
    add_arguments : callable
        Declares its arguments; ``--json``, ``--out`` and ``--debug`` are there already.
    execute : callable
        Does the work and gives the report; known errors are raised.
    goes_on : bool
        Called again after it was interrupted, with the same ``--out``, it finds what is done already.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], Report]
    goes_on: bool = False


def family(name: str, summary: str, members: Sequence[Reporting]) -> Command:
    """The command that has other commands under it.

    Parameters
    ----------
    name, summary : str
    members : sequence of Reporting
    """

    def add_arguments(parser: argparse.ArgumentParser) -> None:
        below = parser.add_subparsers(title=f"what to {name}", metavar="NAME", required=True)
        for member in members:
            text = f"{member.summary[:1].upper()}{member.summary[1:]}."
            sub = below.add_parser(member.name, help=member.summary, description=text, allow_abbrev=False)
            member.add_arguments(sub)
            add_json_option(sub)
            sub.add_argument("--out", metavar="DIR", help="also write report.md and report.json into this folder")
            sub.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show a traceback, too")
            sub.set_defaults(member=member, parser=sub)

    return Command(name, summary, add_arguments, _execute)


def _execute(args: argparse.Namespace) -> int:
    """Find out, print the report as Markdown or JSON, and write it where that is wanted."""
    args.keeps_parts = args.member.goes_on and args.out is not None
    from panoloc_mcl.robot.files import write_atomically
    from panoloc_mcl.tools.report import strict_json

    def as_json(report: Report) -> str:
        return strict_json({"command": args.command_line, **report.data()})

    def keep(report: Report) -> None:
        if args.out is not None:
            write_atomically(Path(args.out) / "report.md", report.markdown())
            write_atomically(Path(args.out) / "report.json", as_json(report))

    # For those that take long: what is there after each part.
    args.keep = keep
    report = args.member.execute(args)
    keep(report)
    print(as_json(report) if args.json else report.markdown(), end="")
    if args.out is not None:
        print(f"written: {args.out}", file=sys.stderr)
    return 0


def at_least(lowest: int) -> Callable[[str], int]:
    """A whole number that is not smaller, for ``type=``."""

    def whole_number(text: str) -> int:
        if int(text) < lowest:
            raise argparse.ArgumentTypeError(f"{text}: must be at least {lowest}")
        return int(text)

    whole_number.__name__ = "int"
    return whole_number


def add_data_options(parser: argparse.ArgumentParser, *, every: bool = True) -> None:
    """``--dataset``, ``--set``, and ``--every`` for what looks at single images."""
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    if every:
        parser.add_argument("--every", type=at_least(1), default=1, metavar="N", help="use every N-th image")
    add_set_option(parser)


def add_processes_option(parser: argparse.ArgumentParser, what: str) -> None:
    """``--processes``."""
    parser.add_argument("--processes", type=at_least(1), default=1, metavar="N", help=f"{what} at work at once")


def config_of(args: argparse.Namespace, **settings: Any) -> RunConfig:
    """The configuration: defaults, these settings, the data set, and ``--set``."""
    from panoloc_mcl.tools.config import Override, config_from_mapping

    named = [Override("dataset", args.dataset, f"--dataset {args.dataset}")]
    return config_from_mapping(settings, args.member.name, [*named, *args.overrides])

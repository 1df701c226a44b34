"""What every command is, and the options that several share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from panoloc_mcl.tools.config import Override


@dataclass(frozen=True)
class Command:
    """One word after ``panoloc``.

    Parameters
    ----------
    name : str
    summary : str
        One line for the list of commands.
    add_arguments : callable
        Declares its arguments.
    execute : callable
        Does the work and gives the exit code; known errors are raised.
    goes_on : bool
        Called again after it was interrupted, it finds what is done already.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], int]
    goes_on: bool = False


def add_set_option(parser: argparse.ArgumentParser) -> None:
    """``--set KEY=VALUE``, as often as wanted."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="set one key of the configuration, dotted, to a YAML value; beats the file; may be repeated",
    )


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """``--json``."""
    parser.add_argument("--json", action="store_true", help="print one JSON object for machines instead of tables and lines")


def overrides_of(args: argparse.Namespace, named: Sequence[Override] = ()) -> list[str | Override]:
    """The values given with ``--set``, and after them those of options of their own, which beat them."""
    return [*args.overrides, *named]

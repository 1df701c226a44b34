"""The parser: one line for what cannot be understood, with the nearest thing that can."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from panoloc_mcl import __version__
from panoloc_mcl.robot.errors import did_you_mean
from panoloc_mcl.tools.cli.command import Command


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    #: Everything that an option can be called here, for "did you mean".
    spellings: tuple[str, ...] = ()

    def add_argument(self, *args: Any, **kwargs: Any) -> argparse.Action:
        """Declare an argument, and remember how it is spelled."""
        action = super().add_argument(*args, **kwargs)
        self.spellings = (*self.spellings, *action.option_strings)
        return action

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            near = did_you_mean(value, map(str, action.choices or ()))
            raise argparse.ArgumentError(action, _joined(error.message, near)) from None

    def error(self, message: str) -> NoReturn:
        """Print the line and leave with code 2."""
        hint = "" if message.endswith("?") else f"; see {self.prog} --help"
        sys.stderr.write(f"{self.prog}: {message}{hint}\n")
        raise SystemExit(2)


def parse(commands: Sequence[Command], argv: Sequence[str]) -> argparse.Namespace:
    """Read a command line.

    Parameters
    ----------
    commands : sequence of Command
    argv : sequence of str
        Without the program's name.

    Returns
    -------
    Namespace
        With ``command`` (a Command), ``parser`` (the innermost, of a command below another), ``debug`` and the command's own
        arguments.

    Raises
    ------
    SystemExit
        After ``--help`` and ``--version`` with code 0, after what cannot be understood with code 2.
    """
    parser, of_command = _build(commands)
    wanted = next((word for word in argv if not word.startswith("-")), None)
    if wanted is not None and wanted not in of_command:
        parser.error(_joined(f"unknown command '{wanted}'", did_you_mean(wanted, of_command)))
    args, unknown = parser.parse_known_args(argv)
    if args.command is None:
        parser.error("no command given")
    if unknown:
        used: Parser = args.parser
        # A word too many is no option in another spelling.
        near = did_you_mean(unknown[0].partition("=")[0], used.spellings) if unknown[0].startswith("-") else ""
        used.error(_joined(f"cannot understand '{unknown[0]}'", near))
    return args


def _build(commands: Sequence[Command]) -> tuple[Parser, dict[str, Parser]]:
    parser = Parser(
        prog="panoloc",
        description="Finds a robot with a panoramic camera in a map of reference panoramas.",
        epilog="'panoloc COMMAND --help' tells more about a command. All configuration keys: CONFIGURATION.md.",
        allow_abbrev=False,
    )
    parser.set_defaults(command=None)
    parser.add_argument("--version", action="version", version=f"panoloc {__version__}")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", parser_class=Parser)
    of_command = {}
    for command in commands:
        sub = subparsers.add_parser(
            command.name, help=command.summary, description=_sentence(command.summary), allow_abbrev=False
        )
        command.add_arguments(sub)
        sub.add_argument("--debug", action="store_true", help="show a traceback with known errors, too")
        sub.add_argument("--version", action="version", version=f"panoloc {__version__}")
        sub.set_defaults(command=command, parser=sub, keeps_parts=False)
        of_command[command.name] = sub
    return parser, of_command


def _joined(message: str, hint: str) -> str:
    return f"{message}; {hint}" if hint else message


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."

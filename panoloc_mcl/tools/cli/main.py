"""The entry point: which commands there are, and what becomes of errors."""

from __future__ import annotations

import importlib
import importlib.util
import io
import os
import sys
from collections.abc import Sequence

from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.tools.cli.command import Command
from panoloc_mcl.tools.cli.notices import plain_warnings
from panoloc_mcl.tools.cli.parser import parse

# In the order of ``panoloc --help``. By name, since the laboratory stands above the tools, and a robot may do without it.
_COMMANDS = (
    "tools.cli.demo",
    "tools.cli.run",
    "tools.cli.convert",
    "tools.cli.live",
    "laboratory.cli.simulate",
    "laboratory.cli.corrupt",
    "tools.cli.maps.build_map",
    "tools.cli.calibrate",
    "tools.cli.maps.update_map",
    "tools.cli.maps.export",
    "laboratory.cli.compare",
    "laboratory.cli.study",
    "laboratory.cli.reproduce",
    "laboratory.cli.benchmark",
    "tools.cli.results.evaluate",
    "tools.cli.results.inspect",
    "tools.cli.results.plot",
    "tools.cli.checks.check",
    "tools.cli.checks.schema",
    "tools.cli.checks.warmup",
)


def commands() -> tuple[Command, ...]:
    """All commands of the parts that are installed."""
    wings = {wing for wing in ("tools", "laboratory") if importlib.util.find_spec(f"panoloc_mcl.{wing}")}
    return tuple(
        importlib.import_module(f"panoloc_mcl.{name}").COMMAND for name in _COMMANDS if name.partition(".")[0] in wings
    )


EXIT_FAULT = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv : sequence of str, optional
        Without the program's name; the process's own otherwise.

    Returns
    -------
    int
        0; 2 after a known error, whose faults stand one a line on standard error; 130 after Ctrl-C. Whatever else is raised
        is a bug and shows its traceback.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    _mend_streams()
    args = parse(commands(), words)
    args.command_line = ["panoloc", *words]
    try:
        with plain_warnings():
            code: int = args.command.execute(args)
        # Here, so that a closed pipe is noticed where it can be handled.
        sys.stdout.flush()
    except PanolocError as error:
        if args.debug:
            raise
        for fault in error.faults:
            print(fault, file=sys.stderr)
        return EXIT_FAULT
    except KeyboardInterrupt:
        if args.debug:
            raise
        if args.command.goes_on or args.keeps_parts:
            print("interrupted; the same command, called again, goes on from here", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # Whoever read the output has enough of it.
        _leave_unwritten()
        return EXIT_BROKEN_PIPE
    except OSError as error:
        if args.debug:
            raise
        where = f"{error.filename}: " if isinstance(error.filename, str) else ""
        print(f"{where}{error.strerror or error}; check permissions and free space", file=sys.stderr)
        _leave_unwritten()
        return EXIT_FAULT
    return code


def _leave_unwritten() -> None:
    """Let go of what standard output does not take: else the interpreter tries to flush it once more, and complains."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _mend_streams() -> None:
    """Write on, whatever the streams are: closed ones take nothing, and characters that theirs lacks are replaced."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or stream.closed:
            # Open as long as the process lives.
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


if __name__ == "__main__":
    sys.exit(main())

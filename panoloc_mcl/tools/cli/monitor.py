"""How far a command has come: bars on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from panoloc_mcl.tools.cli.notices import note

if TYPE_CHECKING:
    import rich.progress

    from panoloc_mcl.tools.runs.pipeline import Monitor

# Between two lines about the same thing, where there is no terminal.
_LINE_EVERY_S = 5.0


@contextmanager
def monitor() -> Iterator[Monitor]:
    """A monitor that suits standard error."""
    if not sys.stderr.isatty():
        yield LineMonitor()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    # As wide as it can get, so that bars do not jump.
    rate = TextColumn("{task.fields[rate]:>10}")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), rate, TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        yield BarMonitor(bars)


class LineMonitor:
    """Writes plain lines: the end of everything, and what takes long in between."""

    def __init__(self) -> None:
        self._written: dict[str, float] = {}

    def progress(self, done: int, total: int, what: str) -> None:
        """Write a line if it is the last step, or if the last line is old."""
        now = time.monotonic()
        since = now - self._written.setdefault(what, now)
        if done == total or since >= _LINE_EVERY_S:
            self._written[what] = now
            print(f"{what}: {done}/{total}", file=sys.stderr, flush=True)

    def notice(self, text: str) -> None:
        """Write it."""
        note(text)


class BarMonitor:
    """Draws a bar for each thing that takes steps."""

    def __init__(self, bars: rich.progress.Progress) -> None:
        self._bars = bars
        self._tasks: dict[str, rich.progress.TaskID] = {}

    def progress(self, done: int, total: int, what: str) -> None:
        """Move the bar."""
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(what, total=total, rate="")
        task = self._tasks[what]
        self._bars.update(task, completed=done, total=total)
        speed = self._bars.tasks[self._bars.task_ids.index(task)].speed
        self._bars.update(task, rate="" if speed is None else f"{speed:.1f}/s")

    def notice(self, text: str) -> None:
        """Write it above the bars."""
        note(text)

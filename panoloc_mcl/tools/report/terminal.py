"""The figures of a run as a table on the terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.evaluation.tables import Table, metrics_table, paper_table

if TYPE_CHECKING:
    import rich.console

# Spaces between two columns.
_GAP = 2
# Titles longer than this are cut, so that figures are not.
_LONGEST_TITLE = 34
# A width that no table needs.
_UNBOUNDED = 10_000


def print_metrics(
    metrics: Mapping[str, Any], console: rich.console.Console | None = None, *, beside_paper: bool = True
) -> None:
    """Print the figures by group, and beside the paper's where its groups were run.

    Parameters
    ----------
    metrics : mapping
        From ``evaluate``.
    console : rich.console.Console, optional
        Standard output otherwise; plain text where that is not a terminal. Columns that do not fit side by side follow
        below; a file or a pipe has no width that they must fit, unless ``COLUMNS`` names one.
    beside_paper : bool
        False leaves the paper's table out, for runs that are nothing like its own.
    """
    from rich.console import Console

    if console is None:
        bounded = sys.stdout.isatty() or "COLUMNS" in os.environ
        console = Console(highlight=False, width=None if bounded else _UNBOUNDED)
    for table in (metrics_table(metrics), paper_table(metrics) if beside_paper else None):
        if table is not None:
            _print_table(table, console)


def _print_table(table: Table, console: rich.console.Console) -> None:
    from rich.table import Table as RichTable
    from rich.text import Text

    spell = _spelling(console.encoding)
    rows = [row for section in table.sections for row in section.rows]
    labels = [spell(f"  {row.label}" + (f" [{row.unit}]" if row.unit else "")) for row in rows]
    titles = max(len(section.title) for section in table.sections)
    label_width = max(*map(len, labels), min(titles, _LONGEST_TITLE))
    widths = [max(len(cell) for cell in [name, *(row.cells[i] for row in rows)]) for i, name in enumerate(table.columns)]
    for block in _blocks(widths, console.width - label_width):
        # Not the table's own title, which is broken where the table ends.
        console.print(Text(spell(table.title), style="italic"))
        shown = RichTable(box=None, padding=(0, _GAP, 0, 0), pad_edge=False)
        shown.add_column("", no_wrap=True, min_width=label_width, max_width=label_width)
        for i in block:
            shown.add_column(Text(spell(table.columns[i])), justify="right", no_wrap=True)
        label = iter(labels)
        for section in table.sections:
            shown.add_row(Text(spell(section.title), style="bold"))
            for row in section.rows:
                shown.add_row(Text(next(label)), *(Text(spell(row.cells[i])) for i in block))
        console.print(shown)
        console.print()


def _blocks(widths: list[int], room: int) -> list[list[int]]:
    """Indices of columns that fit side by side; at least one a block."""
    blocks: list[list[int]] = [[]]
    used = 0
    for i, width in enumerate(widths):
        if blocks[-1] and used + _GAP + width > room:
            blocks.append([])
            used = 0
        blocks[-1].append(i)
        used += _GAP + width
    return blocks


def _spelling(encoding: str) -> Callable[[str], str]:
    """How to spell texts where only ASCII can be shown."""
    if encoding.lower().startswith("utf"):
        return str
    return lambda text: text.replace("–", "-").replace("°", "deg").encode("ascii", "replace").decode("ascii")

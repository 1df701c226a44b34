"""What studies, reproductions and benchmarks answer with: tables whose cells know their interval, as Markdown and as JSON."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from panoloc_mcl.tools.evaluation import bootstrap95, interval95_over_drives
from panoloc_mcl.tools.evaluation.tables import BLANK


class Cell(ABC):
    """A figure with its interval, and the counts behind it."""

    @abstractmethod
    def text(self) -> str:
        """For the Markdown table."""

    @abstractmethod
    def data(self) -> Any:
        """For JSON: plain values."""


@dataclass(frozen=True)
class Rate(Cell):
    """So many of so many, over drives.

    Parameters
    ----------
    hits, trials, drives : int
    interval : (float, float) or None
        95 %, over drives; None without trials.
    """

    hits: int
    trials: int
    drives: int
    interval: tuple[float, float] | None

    @classmethod
    def over(cls, outcomes: Iterable[tuple[str, bool]]) -> Self:
        """From outcomes, each with the drive that it is of."""
        hits: dict[str, int] = defaultdict(int)
        trials: dict[str, int] = defaultdict(int)
        for drive, outcome in outcomes:
            hits[drive] += bool(outcome)
            trials[drive] += 1
        bounds = interval95_over_drives([hits[drive] for drive in trials], list(trials.values()))
        return cls(sum(hits.values()), sum(trials.values()), len(trials), bounds)

    def text(self) -> str:
        """In per cent, with the counts and the interval."""
        if self.interval is None:
            return BLANK
        low, high = (100.0 * bound for bound in self.interval)
        return f"{100.0 * self.hits / self.trials:.1f} % ({self.hits}/{self.trials}; {low:.1f} to {high:.1f})"

    def data(self) -> dict[str, Any]:
        """Counts, rate and interval."""
        rate = self.hits / self.trials if self.trials else None
        return {"hits": self.hits, "trials": self.trials, "drives": self.drives, "rate": rate, "interval95": self.interval}


@dataclass(frozen=True)
class Number(Cell):
    """A number and its decimals; None is one that does not apply."""

    value: float | None
    decimals: int = 0

    def text(self) -> str:
        """With its decimals."""
        return BLANK if self.value is None or math.isnan(self.value) else f"{self.value:.{self.decimals}f}"

    def data(self) -> float | None:
        """The number itself."""
        return self.value


@dataclass(frozen=True)
class Spread(Cell):
    """Median, 95th percentile and maximum of some values, infinite ones included."""

    values: ArrayLike = field(repr=False)
    decimals: int = 0
    shares: tuple[float, ...] = (0.5, 0.95, 1.0)

    def figures(self) -> list[float | None]:
        """The quantiles; without interpolation, which cannot stand infinite values."""
        sample = np.asarray(self.values, dtype=np.float64)
        if not sample.size:
            return [None] * len(self.shares)
        return [float(np.quantile(sample, share, method="inverted_cdf")) for share in self.shares]

    def text(self) -> str:
        """With slashes between them."""
        return " / ".join(Number(figure, self.decimals).text() for figure in self.figures())

    def data(self) -> dict[str, float | None]:
        """By name."""
        names = {0.5: "median", 0.95: "p95", 1.0: "max"}
        return {names[share]: figure for share, figure in zip(self.shares, self.figures(), strict=True)}


@dataclass(frozen=True)
class Ratio(Cell):
    """How many times as large one time is as another, measured in the same rounds.

    Parameters
    ----------
    value : float
        Median over the rounds.
    interval : (float, float)
        95 %, by bootstrap over the rounds, of the geometric mean.
    rounds : int
    """

    value: float
    interval: tuple[float, float]
    rounds: int

    @classmethod
    def of(cls, mine: ArrayLike, theirs: ArrayLike) -> Self:
        """From times of the same rounds, each (n,)."""
        logs = np.log(np.asarray(mine, dtype=np.float64) / np.asarray(theirs, dtype=np.float64))
        low, high = (float(np.exp(bound)) for bound in bootstrap95(logs))
        return cls(float(np.exp(np.median(logs))), (low, high), len(logs))

    def text(self) -> str:
        """With its interval."""
        if self.rounds < 2:
            return f"{self.value:.3g}"
        return f"{self.value:.3g} ({self.interval[0]:.3g} to {self.interval[1]:.3g})"

    def data(self) -> dict[str, Any]:
        """Ratio, interval, rounds."""
        bounds = self.interval if self.rounds > 1 else None
        return {"ratio": self.value, "interval95": bounds, "rounds": self.rounds}


@dataclass
class Table:
    """Rows under named columns; what is no `Cell` is shown as it is."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    note: str = ""

    def add(self, *cells: Any) -> None:
        """One row."""
        if len(cells) != len(self.columns):
            raise ValueError(f"{len(cells)} cells for the {len(self.columns)} columns of '{self.title}'")
        self.rows.append(cells)

    def markdown(self) -> str:
        """Title, note and table."""
        lines = [f"## {self.title}", ""] if self.title else []
        if self.note:
            lines += [self.note, ""]
        lines += [markdown_row(self.columns), markdown_row(["---"] * len(self.columns))]
        return "\n".join([*lines, *(markdown_row([_text(cell) for cell in row]) for row in self.rows)])

    def data(self) -> dict[str, Any]:
        """Title and rows by the names of the columns."""
        rows = [dict(zip(self.columns, map(_data, row), strict=True)) for row in self.rows]
        return {"title": self.title, "note": self.note, "rows": rows}


@dataclass
class Report:
    """What one command found.

    Parameters
    ----------
    title : str
        What was asked, of which data, how many drives and images.
    tables : list of Table
    facts : mapping of str to plain values
        What else JSON says: settings, seeds, counts.
    """

    title: str
    tables: list[Table] = field(default_factory=list)
    facts: Mapping[str, Any] = field(default_factory=dict)

    def table(self, title: str, columns: Sequence[str], note: str = "") -> Table:
        """A new table, added to the report."""
        made = Table(title, tuple(columns), note=note)
        self.tables.append(made)
        return made

    def markdown(self) -> str:
        """The whole report."""
        return "\n\n".join([self.title, *(table.markdown() for table in self.tables)]) + "\n"

    def data(self) -> dict[str, Any]:
        """The whole report for machines."""
        return {"title": self.title, "facts": dict(self.facts), "tables": [table.data() for table in self.tables]}


def markdown_row(cells: Iterable[str]) -> str:
    """One line of a Markdown table."""
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _text(cell: Any) -> str:
    return cell.text() if isinstance(cell, Cell) else BLANK if cell is None else str(cell)


def _data(cell: Any) -> Any:
    return cell.data() if isinstance(cell, Cell) else cell

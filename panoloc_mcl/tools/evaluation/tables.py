"""Metrics as tables of text: one column a group, one row a figure, units in a column of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from panoloc_mcl.tools.evaluation.definitions import WITHIN_TIERS
from panoloc_mcl.tools.evaluation.intervals import wilson95

#: Stands where a figure does not apply.
BLANK = "–"

Figures = Mapping[str, Any]


@dataclass(frozen=True)
class Row:
    """A figure over the columns: its name, its unit (may be empty), and one text a column."""

    label: str
    unit: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Section:
    """Rows that belong together."""

    title: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Table:
    """Sections of rows under the same columns."""

    title: str
    columns: tuple[str, ...]
    sections: tuple[Section, ...]


@dataclass(frozen=True)
class _Figure:
    label: str
    unit: str
    text: Callable[[Figures], str]


def metrics_table(metrics: Mapping[str, Any], by: Literal["groups", "sequences"] = "groups") -> Table:
    """The table of a run.

    Parameters
    ----------
    metrics : mapping
        From ``evaluate``.
    by : {"groups", "sequences"}
        What the columns are. A last column "overall" follows when there are several.

    Returns
    -------
    Table
        Without the sections in which no figure applies.
    """
    columns = dict(metrics[by])
    if len(columns) != 1:
        columns["overall"] = metrics["overall"]
    sections = (
        Section(title, tuple(Row(f.label, f.unit, tuple(f.text(part) for part in columns.values())) for f in figures))
        for title, figures in _SECTIONS
    )
    applying = tuple(s for s in sections if any(cell != BLANK for row in s.rows for cell in row.cells))
    title = "Figures by group" if by == "groups" else "Figures by sequence"
    return Table(title, tuple(columns), applying)


def paper_table(metrics: Mapping[str, Any]) -> Table | None:
    """Recognition and lost tracks beside Table 2 of the paper.

    Returns
    -------
    Table or None
        A section for each of the groups noon, afternoon and evening that was run; None when none of them was.
    """
    lights = [light for light in PAPER_TABLE_2 if light in metrics["groups"]]
    if not lights:
        return None
    sections = []
    for light in lights:
        pair = (_paper_figures(light), metrics["groups"][light])
        rows = tuple(Row(f.label, f.unit, tuple(f.text(part) for part in pair)) for f in _PAPER_FIGURES)
        sections.append(Section(light.capitalize(), rows))
    return Table("Beside Table 2 of Steinbauer & Bischof (2004)", ("paper", "here"), tuple(sections))


@dataclass(frozen=True)
class PaperResult:
    """A line of the paper's Table 2."""

    trials: int
    passed: int
    recognised: int
    tracks_lost: int


PAPER_TABLE_2 = {
    "noon": PaperResult(10, 225, 225, 0),
    "afternoon": PaperResult(10, 231, 220, 0),
    "evening": PaperResult(10, 193, 161, 2),
}


def _paper_figures(light: str) -> Figures:
    paper = PAPER_TABLE_2[light]
    recognition = {
        "passed": paper.passed,
        "recognised": paper.recognised,
        "rate": paper.recognised / paper.passed,
        "wilson95": wilson95(paper.recognised, paper.passed),
    }
    return {"runs": paper.trials, "recognition": recognition, "tracks_lost": paper.tracks_lost}


def number(value: float | None, decimals: int) -> str:
    """A number with fixed decimals, or the blank."""
    return BLANK if value is None else f"{value:.{decimals}f}"


def percent(share: float | None, decimals: int = 1) -> str:
    """A share as percent without the sign, or the blank."""
    return BLANK if share is None else f"{100 * share:.{decimals}f}"


def interval(bounds: Sequence[float] | None) -> str:
    """An interval of shares as percent, or the blank."""
    return BLANK if bounds is None else f"{percent(bounds[0])}–{percent(bounds[1])}"


def out_of(count: int | None, total: int | None) -> str:
    """``count/total``, or the blank."""
    return BLANK if count is None or total is None else f"{count}/{total}"


def _plain(label: str, unit: str, key: str, decimals: int) -> _Figure:
    return _Figure(label, unit, lambda part: number(part[key], decimals))


def _nested(label: str, unit: str, outer: str, key: str, decimals: int) -> _Figure:
    return _Figure(label, unit, lambda part: number(part[outer][key], decimals))


def _share(label: str, outer: str, key: str) -> _Figure:
    return _Figure(label, "%", lambda part: percent(part[outer][key]))


def _wilson(outer: str) -> _Figure:
    return _Figure("  95 %, over drives", "%", lambda part: interval(part[outer]["wilson95"]))


def _counts(label: str, outer: str, count: str, total: str) -> _Figure:
    return _Figure(label, "", lambda part: out_of(part[outer][count], part[outer][total]))


def _claimed(label: str, axis: str, key: str) -> _Figure:
    def text(part: Figures) -> str:
        # Folders of earlier versions say nothing of it.
        value = part.get("consistency", {}).get(axis, {}).get(key)
        return percent(value) if key.startswith("inside") else number(value, 2)

    return _Figure(label, "%" if key.startswith("inside") else "", text)


_RECOGNITION = (
    _counts("recognised/passed", "recognition", "recognised", "passed"),
    _share("rate", "recognition", "rate"),
    _wilson("recognition"),
)

_PAPER_FIGURES = (
    _plain("runs", "", "runs", 0),
    *_RECOGNITION,
    _plain("tracks lost", "", "tracks_lost", 0),
)

_SECTIONS: tuple[tuple[str, tuple[_Figure, ...]], ...] = (
    (
        "Accuracy after convergence",
        (
            _plain("position, median", "m", "position_median_m", 4),
            _plain("position, mean", "m", "position_mean_m", 4),
            _plain("position, RMSE", "m", "position_rmse_m", 4),
            _plain("position, p95", "m", "position_p95_m", 4),
            _plain("heading, median", "°", "heading_median_deg", 3),
            _plain("heading, p95", "°", "heading_p95_deg", 3),
        ),
    ),
    (
        "Error against claimed covariance",
        (
            _claimed("position, median NEES (right: 1)", "position", "nees_median"),
            _claimed("position within 2 sd (right: 86.5)", "position", "inside_2sd"),
            _claimed("heading, median NEES (right: 1)", "heading", "nees_median"),
            _claimed("heading within 2 sd (right: 95.4)", "heading", "inside_2sd"),
        ),
    ),
    (
        "All frames",
        (
            _plain("APE, RMSE", "m", "ape_rmse_m", 4),
            *(_share(f"within {metres:.2f} m, {degrees:g}°", "within", name) for name, metres, degrees in WITHIN_TIERS),
        ),
    ),
    ("Recognition of places", _RECOGNITION),
    (
        "Finding itself",
        (
            _counts("runs succeeded", "global_success", "succeeded", "runs"),
            _share("rate", "global_success", "rate"),
            _wilson("global_success"),
            _counts("runs sure but wrong", "false_convergence", "count", "runs"),
            _plain("images, median", "", "frames_to_converge_median", 1),
            _plain("time, median", "s", "seconds_to_converge_median", 2),
            _plain("tracks lost", "", "tracks_lost", 0),
        ),
    ),
    (
        "Kidnaps",
        (
            _counts("recovered", "kidnap", "recovered", "events"),
            _share("rate", "kidnap", "rate"),
            _wilson("kidnap"),
            _nested("images, median", "", "kidnap", "frames_to_recover_median", 1),
        ),
    ),
    (
        "Time of one image",
        (_nested("median", "ms", "step_ms", "median", 1), _nested("p95", "ms", "step_ms", "p95", 1)),
    ),
    ("Data", (_plain("frames", "", "frames", 0), _plain("runs", "", "runs", 0))),
)

"""Plots of a comparison as PNG files, drawn without a display; needs the extra ``plot``."""

from __future__ import annotations

import importlib.util
import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from panoloc_mcl.laboratory.comparison.pooling import Group
from panoloc_mcl.laboratory.corruptions.imperfections import IMPERFECTIONS, LEVELS
from panoloc_mcl.laboratory.corruptions.recipe import CLEAN, EVERYTHING
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.tools.evaluation.intervals import wilson95

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Style = dict[str, Any]

# Okabe and Ito: told apart by colour-blind readers; line styles go on where the colours end.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d00")
_STYLES = ("-", "--", ":")
_MARKERS = ("o", "s", "^")
# Above so many decades, an axis has room for powers of ten alone.
_MOST_DECADES = 2.5
_MOST_PANELS = 12
_PANEL_IN = (3.4, 2.7)
_LEGEND_ROW_IN = 0.17
# A logarithmic axis shows no zero.
_LEAST_MM = 0.1
#: The severity of a corruption that changes nothing.
_NEUTRAL = {"gain": 1.0}


def can_draw() -> bool:
    """Whether the plotting library is there."""
    return importlib.util.find_spec("matplotlib") is not None


def draw_plots(folder: Path, groups: Sequence[Group]) -> list[str]:
    """Draw what there is to draw.

    Parameters
    ----------
    folder : Path
    groups : sequence of Group

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    plots: dict[str, Callable[[Sequence[Group]], Figure | None]] = {
        "errors.png": draw_errors,
        "severity.png": draw_severity,
        "convergence.png": draw_convergence,
        "cost.png": draw_cost,
        "imperfections.png": draw_imperfections,
    }
    shown = [group for group in groups if group.metrics is not None]
    drawn = []
    for name, draw in plots.items():
        figure = draw(shown) if shown else None
        if figure is not None:
            save_png(figure, folder / name)
            drawn.append(name)
        else:
            (folder / name).unlink(missing_ok=True)
    return drawn


def save_png(figure: Figure, path: Path, dpi: int = 130) -> None:
    """Write a figure, whole or not at all."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=dpi, metadata={"Software": None})
    write_atomically(path, out.getvalue())


def draw_errors(groups: Sequence[Group]) -> Figure | None:
    """Distribution of the position error of all images, one panel a condition."""

    def panel(axes: Axes, group: Group, style: Style) -> None:
        errors = [record.position_error_m for record in group.records]
        known = [error for error in errors if error is not None]
        if known:
            values = np.sort(np.maximum(1000.0 * np.concatenate(known), _LEAST_MM))
            axes.plot(values, np.arange(1, len(values) + 1) / len(values), label=group.method, linewidth=1.3, **style)

    figure = _panels(groups, panel, "position error of all images [mm]", "share of images")
    for axes in figure.axes:
        _plain_log(axes, "x")
    return figure


def draw_convergence(groups: Sequence[Group]) -> Figure | None:
    """Share of runs that have converged after so many images, one panel a condition."""
    longest = max(len(record) for group in groups for record in group.records)

    def panel(axes: Axes, group: Group, style: Style) -> None:
        firsts = [record.first_converged for record in group.records]
        after = np.sort([np.inf if first is None else first + 1.0 for first in firsts])
        images = np.arange(1, longest + 1)
        axes.step(
            images,
            np.searchsorted(after, images, side="right") / len(after),
            where="post",
            label=group.method,
            linewidth=1.3,
            **style,
        )

    figure = _panels(groups, panel, "images", "share of runs converged")
    for axes in figure.axes:
        _plain_log(axes, "x")
        axes.set_ylim(-0.03, 1.03)
    return figure


def draw_severity(groups: Sequence[Group]) -> Figure | None:
    """Runs succeeded and places recognised against the severity of each corruption that has several; lights pooled."""
    kinds: dict[str, dict[float, list[Group]]] = {}
    clean = [group for group in groups if group.axes["corruption"] == CLEAN]
    for group in groups:
        match = re.fullmatch(r"(\w+):([\d.]+)", group.axes["corruption"])
        if match:
            kinds.setdefault(match[1], {}).setdefault(float(match[2]), []).append(group)
    kinds = {kind: severities for kind, severities in kinds.items() if len(severities) + bool(clean) > 1}
    if not kinds:
        return None
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2 * _PANEL_IN[0] + 0.4, _PANEL_IN[1] * len(kinds) + 0.7), layout="constrained")
    panels = figure.subplots(len(kinds), 2, squeeze=False, sharey=True)
    styles = _styles(groups)
    for row, (kind, severities) in zip(panels, kinds.items(), strict=True):
        if clean:
            severities.setdefault(_NEUTRAL.get(kind, 0.0), clean)
        for axes, figure_of, title in (
            (row[0], "global_success", "runs succeeded"),
            (row[1], "recognition", "places recognised"),
        ):
            for number, (method, style) in enumerate(styles.items()):
                mine = {severity: [g for g in part if g.method == method] for severity, part in severities.items()}
                # Side by side, so that equal rates do not hide each other.
                aside = (number - 0.5 * (len(styles) - 1)) * min(0.012, 0.08 / len(styles)) * max(severities)
                draw_rates(axes, mine, figure_of, method, style, aside)
            _finish(axes, f"{kind}: {title}", kind, "share")
            axes.set_ylim(-0.03, 1.03)
    _legend(figure, panels[0][0])
    return figure


def draw_imperfections(groups: Sequence[Group]) -> Figure | None:
    """Median to p95 of the position error under each imperfection, mild and strong, data sets and lights pooled; clean as a band."""
    errors: dict[str, list[Any]] = {}
    for group in groups:
        mine = errors.setdefault(group.axes["corruption"], [])
        for record in group.records:
            first, metres = record.first_converged, record.position_error_m
            mine.append(metres[first:] if metres is not None and first is not None else [])
    spreads: dict[str, Any] = {}
    for recipe, parts in errors.items():
        if any(map(len, parts)):
            spreads[recipe] = np.maximum(1000.0 * np.percentile(np.concatenate(parts), (50, 95)), _LEAST_MM)
        else:
            spreads[recipe] = None
    names = [name for name in (EVERYTHING, *IMPERFECTIONS) if any(f"{name}:{level}" in spreads for level in LEVELS)]
    if not names:
        return None
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6, 0.26 * len(names) + 1.2), layout="constrained")
    axes = figure.add_subplot()
    clean = spreads.get(CLEAN)
    if clean is not None:
        axes.axvspan(*clean, color="0.85", label="clean: median to p95")
    for level, colour, aside in zip(LEVELS, _COLOURS, (0.16, -0.16), strict=False):
        rows_of_level = [
            (len(names) - row + aside, spreads[f"{name}:{level}"])
            for row, name in enumerate(names)
            if f"{name}:{level}" in spreads
        ]
        found = [(y, spread) for y, spread in rows_of_level if spread is not None]
        if found:
            ys, (low, high) = [y for y, _ in found], np.transpose([spread for _, spread in found])
            axes.hlines(ys, low, high, color=colour, linewidth=2.0, label=f"{level}: median to p95")
            axes.plot(low, ys, marker="o", markersize=3.5, linestyle="none", color=colour)
        for y in [y for y, spread in rows_of_level if spread is None]:
            axes.annotate(
                "never sure", (0.99, y), xycoords=("axes fraction", "data"), ha="right", va="center", fontsize=7, color=colour
            )
    _plain_log(axes, "x")
    axes.set_yticks([len(names) - row for row in range(len(names))], [name.replace("_", " ") for name in names])
    _finish(axes, "", "position error after convergence [mm]", "")
    _legend(figure, axes)
    return figure


def draw_rates(
    axes: Axes, by_severity: dict[float, list[Group]], figure: str, label: str, style: Style, aside: float = 0.0
) -> None:
    """A rate with Wilson intervals against severity: ``global_success`` or ``recognition`` of groups, counts added up.

    Points stand ``aside`` by so much, in units of the severity.
    """
    hits, trials = ("succeeded", "runs") if figure == "global_success" else ("recognised", "passed")
    points = []
    for severity in sorted(by_severity):
        parts = [group.metrics[figure] for group in by_severity[severity] if group.metrics is not None]
        hit, trial = (sum(part[key] or 0 for part in parts) for key in (hits, trials))
        bounds = wilson95(hit, trial)
        if bounds is not None:
            points.append((severity + aside, hit / trial, *bounds))
    if points:
        x, y, low, high = np.array(points).T
        axes.errorbar(
            x, y, yerr=(y - low, high - y), label=label, marker="o", markersize=3.5, linewidth=1.3, capsize=2, **style
        )


def draw_cost(groups: Sequence[Group]) -> Figure | None:
    """Median position error of all images against the time of one image: one point a method, over all clean conditions."""
    from matplotlib.figure import Figure

    clean = [group for group in groups if group.axes["corruption"] == CLEAN] or list(groups)
    points: dict[str, tuple[float, float]] = {}
    for method in _styles(clean):
        records = [record for group in clean if group.method == method for record in group.records]
        ms = np.concatenate([record.step_ms for record in records])
        errors = [record.position_error_m for record in records]
        known = [error for error in errors if error is not None]
        if known and not np.isnan(ms).all():
            points[method] = float(np.nanmedian(ms)), max(1000.0 * float(np.median(np.concatenate(known))), _LEAST_MM)
    if not points:
        return None
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for method, style in _styles(clean).items():
        if method in points:
            marker = _MARKERS[_STYLES.index(style["linestyle"])]
            axes.plot(*points[method], marker=marker, linestyle="none", color=style["color"], label=method)
    for which in ("x", "y"):
        _plain_log(axes, which)
    axes.margins(0.15)
    _finish(axes, "", "time of one image, pixels to pose: median [ms]", "median position error of all images [mm]")
    axes.grid(True, which="minor", alpha=0.1, linewidth=0.4)
    _legend(figure, axes)
    return figure


def _panels(groups: Sequence[Group], draw: Callable[[Axes, Group, Style], None], x_label: str, y_label: str) -> Figure:
    from matplotlib.figure import Figure

    conditions = list(dict.fromkeys(group.condition for group in groups))
    if len(conditions) > _MOST_PANELS:
        clean = list(dict.fromkeys(group.condition for group in groups if group.axes["corruption"] == CLEAN))
        conditions = (clean or conditions)[:_MOST_PANELS]
    columns = 2 if len(conditions) in (2, 4) else min(3, len(conditions))
    rows = -(-len(conditions) // columns)
    figure = Figure(figsize=(_PANEL_IN[0] * columns + 0.4, _PANEL_IN[1] * rows + 0.7), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    styles = _styles(groups)
    for axes, condition in zip(panels.flat, conditions, strict=False):
        for group in groups:
            if group.condition == condition:
                draw(axes, group, styles[group.method])
        _finish(axes, condition, "", "")
    for axes in list(panels.flat)[len(conditions) :]:
        axes.remove()
    # Below a panel that is not there, the one above shows its numbers.
    for axes in panels.flat[max(0, len(conditions) - columns) : len(conditions)]:
        axes.tick_params(labelbottom=True)
    figure.supxlabel(x_label, fontsize=9)
    figure.supylabel(y_label, fontsize=9)
    _legend(figure, panels.flat[0])
    return figure


def _plain_log(axes: Axes, which: str) -> None:
    """A logarithmic axis with plain numbers, at 1, 2 and 5 where there is room for them; call it when all is drawn."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    getattr(axes, f"set_{which}scale")("log")
    low, high = getattr(axes, f"get_{which}lim")()
    steps = (1.0, 2.0, 5.0) if np.log10(high / low) < _MOST_DECADES else (1.0,)
    axis = getattr(axes, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=steps, numticks=20))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _styles(groups: Sequence[Group]) -> dict[str, Style]:
    methods = list(dict.fromkeys(group.method for group in groups))
    return {
        method: {"color": _COLOURS[index % len(_COLOURS)], "linestyle": _STYLES[index // len(_COLOURS) % len(_STYLES)]}
        for index, method in enumerate(methods)
    }


def _finish(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(x_label, fontsize=9)
    axes.set_ylabel(y_label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(True, alpha=0.25, linewidth=0.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        widest = max(len(label) for label in labels)
        columns = int(np.clip(figure.get_figwidth() * 13 // (widest + 6), 1, len(labels)))
        figure.set_figheight(figure.get_figheight() + _LEGEND_ROW_IN * (-(-len(labels) // columns) - 1))
        figure.legend(handles, labels, loc="outside upper left", ncols=columns, fontsize=8, frameon=False)

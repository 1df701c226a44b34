"""Figures over time: heading, status, particles, time of the stages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.report.figures.style import BLUE, GREEN, INK, ORANGE, RED, SKY, STATUS_COLORS, WIDTH_IN, YELLOW
from panoloc_mcl.tools.report.results.steps import STAGE_PREFIX, TOTAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Names of the figures that `draw_series` makes.
SERIES = ("heading", "status", "particles", "stages")
_HEIGHTS_IN = {"heading": 2.4, "status": 1.15, "particles": 2.4, "stages": 2.4}


def draw_series(name: str, record: SequenceRecord, steps: Mapping[str, FloatArray]) -> Figure:
    """One of ``SERIES``.

    Parameters
    ----------
    name : str
    record : SequenceRecord
    steps : mapping of str to float64 (n,)
        Columns of ``steps.csv``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, _HEIGHTS_IN[name]), layout="constrained", facecolor="none")
    axes = figure.add_subplot(facecolor="none")
    axes.set_axisbelow(True)
    axes.grid(True)
    seconds = record.times - record.times[0]
    _DRAW[name](axes, record, steps, seconds)
    label: str | None = "carried away"
    for i in np.flatnonzero(record.kidnapped):
        axes.axvline(seconds[i], color=INK, linewidth=0.9, linestyle=(0, (1, 2)), label=label)
        label = None
    axes.set_xlabel("time since the first image [s]")
    axes.margins(x=0.01)
    figure.legend(loc="outside upper left", ncols=3, handlelength=1.4, columnspacing=1.0)
    return figure


def _heading(axes: Axes, record: SequenceRecord, steps: Mapping[str, FloatArray], seconds: FloatArray) -> None:
    def degrees(heading: FloatArray) -> FloatArray:
        return np.asarray(np.degrees(np.arctan2(np.sin(heading), np.cos(heading))))

    if record.truth is not None:
        axes.plot(seconds, degrees(record.truth[:, 2]), "o", markersize=5.5, markerfacecolor="none", color=INK, label="truth")
    axes.plot(seconds, degrees(record.poses[:, 2]), "o", markersize=2.8, color=RED, label="estimate")
    axes.set_ylim(-190, 190)
    axes.set_yticks([-180, -90, 0, 90, 180])
    axes.set_ylabel("heading [°]")


def _status(axes: Axes, record: SequenceRecord, steps: Mapping[str, FloatArray], seconds: FloatArray) -> None:
    last = 2.0 * seconds[-1] - seconds[-2] if len(seconds) > 1 else 1.0
    widths = np.diff(np.append(seconds, last))
    for status, color in STATUS_COLORS.items():
        here = np.array([s == status for s in record.status])
        # Without bars, the legend would show a colour that is not this status's.
        if not here.any():
            continue
        # Each has a hatch of its own, for print without colours.
        hatch = {"searching": "////", "converged": "", "ambiguous": "xxxx", "lost": "....", "stale": "----"}[status]
        axes.bar(
            seconds[here],
            np.ones(here.sum()),
            widths[here],
            align="edge",
            color=color,
            hatch=hatch,
            label=status,
            edgecolor="#333333",
            linewidth=0,
        )
    axes.set_yticks([])
    axes.set_ylim(0, 1)


def _particles(axes: Axes, record: SequenceRecord, steps: Mapping[str, FloatArray], seconds: FloatArray) -> None:
    axes.plot(seconds, steps["particles"], color=ORANGE, linewidth=1.2, linestyle="--", label="particles")
    axes.plot(seconds, steps["n_eff"], color=BLUE, linewidth=1.2, label="effective, before resampling")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("particles")


def _stages(axes: Axes, record: SequenceRecord, steps: Mapping[str, FloatArray], seconds: FloatArray) -> None:
    bottom = np.zeros(len(seconds))
    width = 0.9 * float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.9
    names = [name for name in steps if name.startswith(STAGE_PREFIX) and name != TOTAL]
    for name, color in zip(names, (BLUE, ORANGE, SKY, YELLOW, GREEN, RED) * len(names), strict=False):
        height = np.nan_to_num(steps[name])
        axes.bar(seconds, height, width, bottom, color=color, label=name.removeprefix(STAGE_PREFIX))
        bottom += height
    axes.set_ylabel("time of one image [ms]")
    # The first image may be slow, as kernels are loaded: it must not flatten the others.
    high = 1.6 * float(np.quantile(bottom, 0.9, method="lower"))
    if bottom.max() <= high:
        return
    axes.set_ylim(0.0, high)
    # Texts of neighbours would lie over each other.
    slowest = int(np.argmax(bottom))
    axes.annotate(
        f"↑ {bottom[slowest]:.0f} ms",
        (seconds[slowest] + 0.5 * width, 1.0),
        (2, -2),
        axes.get_xaxis_transform(),
        textcoords="offset points",
        ha="left",
        va="top",
        fontsize=8.0,
    )


_DRAW: dict[str, Callable[[Axes, SequenceRecord, Mapping[str, FloatArray], FloatArray], None]] = {
    "heading": _heading,
    "status": _status,
    "particles": _particles,
    "stages": _stages,
}

"""Trajectory and errors of one run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation.definitions import GOOD_HEADING_DEG, GOOD_POSITION_M
from panoloc_mcl.tools.evaluation.record import SequenceRecord
from panoloc_mcl.tools.report.figures.style import CONVERGED, INK, PLACES, SEARCHING, WIDTH_IN, style, svg_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# More than these only make the file large: markers of places are then one image, lines take the largest error of a bin.
_MOST_MARKERS = 300
_MOST_POINTS = 1500
# A logarithmic axis shows no zero.
_LEAST_M, _LEAST_DEG = 1e-3, 1e-2


def trajectory_svg(record: SequenceRecord, place_positions: FloatArray) -> str:
    """Estimate, truth and places from above, metres, equal axes.

    Parameters
    ----------
    record : SequenceRecord
    place_positions : ndarray of float64, shape (P, 2)

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    with style(f"trajectory {record.name} {record.run}"):
        figure = draw_trajectory(record, place_positions)
        return svg_text(figure, f"{record.name}, run {record.run}: estimated and true trajectory on the places")


def errors_svg(record: SequenceRecord) -> str | None:
    """Position and heading error over time as an ``<svg>`` element; None without truth."""
    if record.truth is None:
        return None
    with style(f"errors {record.name} {record.run}"):
        return svg_text(draw_errors(record), f"{record.name}, run {record.run}: position and heading error over time")


def draw_trajectory(record: SequenceRecord, place_positions: FloatArray) -> Figure:
    """The figure behind ``trajectory_svg``."""
    from matplotlib.figure import Figure

    converged = record.converged
    drawn = [place_positions, record.poses[converged, :2]]
    if record.truth is not None:
        drawn.append(record.truth[record.has_truth, :2])
    everything = np.concatenate(drawn)
    extent = np.ptp(everything if len(everything) else record.poses[:, :2], axis=0) + 0.5
    # Tall enough that the equal axes fill the width, within reason.
    height = float(np.clip((WIDTH_IN - 0.6) * extent[1] / extent[0], 1.6, 4.6)) + 1.0
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained", facecolor="none")
    axes = figure.add_subplot(facecolor="none")
    axes.set_axisbelow(True)
    axes.grid(True)
    if len(place_positions):
        many = len(place_positions) > _MOST_MARKERS
        size = 3.0 if many else 14.0
        x, y = place_positions.T
        axes.scatter(x, y, s=size, marker="+", color=PLACES, linewidths=0.7, label="places", rasterized=many)
    if record.truth is not None:
        axes.plot(*_split(record.truth[:, :2], record.kidnapped), color=INK, linewidth=1.0, label="truth")
        first = record.truth[record.has_truth][:1, :2]
        axes.plot(*first.T, color=INK, marker="o", markersize=4.5, linestyle="none", label="start")
    if converged.any():
        estimate = np.where(converged[:, None], record.poses[:, :2], np.nan)
        line = _split(estimate, record.kidnapped)
        axes.plot(*line, color=CONVERGED, linewidth=1.4, marker=".", markersize=2.5, label="estimate, converged")
    if not converged.all():
        others = np.flatnonzero(~converged)
        others = others[:: -(-len(others) // _MOST_MARKERS)]
        x, y = record.poses[others, :2].T
        axes.scatter(x, y, s=10, facecolors="none", edgecolors=SEARCHING, linewidths=0.8, label="not converged")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.legend(loc="outside upper left", ncols=2, handlelength=1.6, columnspacing=1.2)
    return figure


def draw_errors(record: SequenceRecord) -> Figure:
    """The figure behind ``errors_svg``.

    Raises
    ------
    ResultsError
        The record has no truth.
    """
    from matplotlib.figure import Figure

    position, heading = record.position_error_m, record.heading_error_deg
    if position is None or heading is None:
        raise ResultsError(
            f"sequence {record.name}: has no ground truth, so there are no errors to draw; draw trajectory or status"
        )
    figure = Figure(figsize=(WIDTH_IN, 3.9), layout="constrained", facecolor="none")
    upper, lower = figure.subplots(2, 1, sharex=True)
    seconds = record.times - record.times[0]
    _draw_error(upper, record, seconds, np.maximum(position, _LEAST_M), GOOD_POSITION_M)
    _draw_error(lower, record, seconds, np.maximum(heading, _LEAST_DEG), GOOD_HEADING_DEG)
    upper.set_ylabel("position error [m]")
    lower.set_ylabel("heading error [°]")
    lower.set_xlabel("time since the first image [s]")
    figure.align_ylabels([upper, lower])
    handles, labels = upper.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2, handlelength=1.6, columnspacing=1.2)
    return figure


def _draw_error(axes: Axes, record: SequenceRecord, seconds: FloatArray, error: FloatArray, limit: float) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axes.set_facecolor("none")
    axes.set_axisbelow(True)
    axes.grid(True)
    axes.set_yscale("log")
    label: str | None = "not converged"
    for start, stop in _spans(~record.converged):
        # Up to the next frame, so that a single frame is a span too.
        end = seconds[min(stop, len(seconds) - 1)]
        axes.axvspan(seconds[start], end, color=SEARCHING, alpha=0.2, linewidth=0, label=label)
        label = None
    x, y = _largest_of_bins(seconds, error)
    axes.plot(x, y, color=CONVERGED, linewidth=1.1, marker="." if len(x) < 40 else None, markersize=3, label="error")
    axes.axhline(limit, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="limit of success")
    label = "carried away"
    for i in np.flatnonzero(record.kidnapped):
        axes.axvline(seconds[i], color=INK, linewidth=0.9, linestyle=(0, (1, 2)), label=label)
        label = None
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.margins(x=0.01)


def _split(points: FloatArray, kidnapped: NDArray[np.bool_]) -> FloatArray:
    """Points as rows x and y, with a gap before each teleport, shape (2, n + teleports)."""
    return np.insert(points, np.flatnonzero(kidnapped), np.nan, axis=0).T


def _spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _largest_of_bins(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    width = -(-len(x) // _MOST_POINTS)
    starts = np.arange(0, len(x), width)
    return x[starts], np.maximum.reduceat(y, starts)

"""All runs of a results folder in one figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.report.figures.style import BLUE, GREEN, INK, ORANGE, PINK, PLACES, RED, SKY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEAST_M, _MOST_M = 1e-3, 10.0
_LINES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (RED, ":"), (PINK, "-"), (SKY, "--"), (INK, "-."))


def draw_overview(records: Sequence[SequenceRecord], place_positions: FloatArray) -> Figure:
    """Estimates on the map, coloured by their error, and the share of frames by error for each group.

    Parameters
    ----------
    records : sequence of SequenceRecord
    place_positions : float64 (P, 2)
        Metres.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.6), layout="constrained", facecolor="none")
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.set_facecolor("none")
        axes.set_axisbelow(True)
        axes.grid(True)
    _draw_map(figure, left, records, place_positions)
    _draw_shares(figure, right, records)
    return figure


def _draw_map(figure: Figure, axes: Axes, records: Sequence[SequenceRecord], place_positions: FloatArray) -> None:
    from matplotlib.colors import LogNorm

    axes.plot(*place_positions.T, "+", color=PLACES, markersize=5, markeredgewidth=0.7)
    for record in records:
        error = record.position_error_m
        if error is None:
            axes.plot(*record.poses[:, :2].T, ".", color=BLUE, markersize=3)
            continue
        x, y = record.poses[:, :2].T
        dots = axes.scatter(x, y, c=np.clip(error, _LEAST_M, _MOST_M), s=9, cmap="viridis", norm=LogNorm(_LEAST_M, _MOST_M))
    if any(record.truth is not None for record in records):
        figure.colorbar(dots, ax=axes, label="position error [m]", location="bottom", shrink=0.8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title("estimates; crosses: places", loc="left", fontsize=9)


def _draw_shares(figure: Figure, axes: Axes, records: Sequence[SequenceRecord]) -> None:
    groups: dict[str, list[FloatArray]] = {}
    for record in records:
        if record.position_error_m is not None:
            groups.setdefault(record.group, []).append(record.position_error_m)
    for number, (group, errors) in enumerate(groups.items()):
        color, line = _LINES[number % len(_LINES)]
        ordered = np.sort(np.maximum(np.concatenate(errors), _LEAST_M / 10.0))
        share = 100.0 * np.arange(1, len(ordered) + 1) / len(ordered)
        axes.step(ordered, share, where="post", color=color, linestyle=line, linewidth=1.3, label=group)
    axes.set_xscale("log")
    axes.set_ylim(0, 102)
    axes.set_xlabel("position error [m]")
    axes.set_ylabel("frames with at most this error [%]")
    if groups:
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, handlelength=2.0, columnspacing=1.0, borderaxespad=0.1
        )

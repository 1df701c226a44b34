"""A picture of the graph of keyframes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from panoloc_mcl.robot.map.keyframes import LOOP, Keyframes
from panoloc_mcl.tools.report.figures.style import BLUE, GREEN, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GREY = "0.75"


def draw_graph(keyframes: Keyframes) -> Figure:
    """Keyframes with their edges, where they were given, and how sure they are."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 6.2), layout="constrained")
    axes = figure.subplots()
    draw_graph_on(axes, keyframes)
    return figure


def draw_graph_on(axes: Axes, keyframes: Keyframes) -> None:
    """The same, on axes that are there."""
    from matplotlib.collections import EllipseCollection, LineCollection

    edges, positions = keyframes.edges, keyframes.poses[:, :2]
    axes.set_axisbelow(True)
    axes.grid(True)
    lines = np.stack([positions[edges.first], positions[edges.second]], axis=1) if len(edges) else np.zeros((0, 2, 2))
    believed, loops = edges.weights >= 0.5, edges.kinds == LOOP
    parts = (
        ("contradicted", ~believed, RED, 0.5),
        ("relative pose", believed & ~loops, _GREY, 0.8),
        ("met again", believed & loops, GREEN, 0.8),
    )
    for label, which, color, width in parts:
        if which.any():
            axes.add_collection(LineCollection(list(lines[which]), colors=color, linewidths=width, label=label))
    surveyed = not any(keyframes.drives)
    if surveyed and np.any(keyframes.moved_m > 0.0):
        moved = np.stack([keyframes.given[:, :2], positions], axis=1)
        axes.add_collection(LineCollection(list(moved), colors=ORANGE, linewidths=0.9))
        axes.plot(*keyframes.given[:, :2].T, "x", color=ORANGE, markersize=4, label="as given")
    values, vectors = np.linalg.eigh(keyframes.covariances[:, :2, :2])
    # Three standard deviations, as they may be too small to see.
    axes.add_collection(
        EllipseCollection(
            6.0 * np.sqrt(np.maximum(values[:, 1], 0.0)),
            6.0 * np.sqrt(np.maximum(values[:, 0], 0.0)),
            np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])),
            units="xy",
            offsets=positions,
            offset_transform=axes.transData,
            facecolors="none",
            edgecolors=BLUE,
            linewidths=0.6,
        )
    )
    axes.plot([], [], "o", color=BLUE, fillstyle="none", label="3 standard deviations")
    axes.plot(*positions.T, ".", color=BLUE, markersize=4, label="keyframe")
    ahead = 0.12 * np.column_stack([np.cos(keyframes.poses[:, 2]), np.sin(keyframes.poses[:, 2])])
    axes.add_collection(LineCollection(list(np.stack([positions, positions + ahead], axis=1)), colors=BLUE, linewidths=0.8))
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, handlelength=1.4, columnspacing=0.9, borderaxespad=0.2)

"""Pictures of what is in a map or a data set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.evaluation.record import group_of
from panoloc_mcl.tools.report.figures.graph import draw_graph_on
from panoloc_mcl.tools.report.figures.style import BLUE, GREEN, ORANGE, PINK, RED, SKY, VOTE_COLORS
from panoloc_mcl.tools.report.inspection import Confusion, Eigenimages

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS = (ORANGE, GREEN, RED, PINK, SKY)


def draw_map_inspection(
    references: ReferencePanoramas,
    places: Places,
    eigen: Eigenimages,
    confusion: Confusion | None,
    dataset: Dataset | None = None,
    keyframes: Keyframes | None = None,
) -> Figure:
    """Mean image, eigenimages, variance kept, coverage; and which places are confused, or where the drives go.

    Parameters
    ----------
    references : ReferencePanoramas
    places : Places
        That are voted for.
    eigen : Eigenimages
    confusion : Confusion or None
        Of a map.
    dataset : Dataset, optional
        Whose drives are drawn.
    keyframes : Keyframes, optional
        Whose graph is drawn.
    """
    from matplotlib.figure import Figure

    graph = keyframes is not None and len(keyframes.edges) > 0
    figure = Figure(figsize=(8.4, 12.2 if graph else 7.2), layout="constrained", facecolor="none")
    parts: Any = figure.subfigures(3 if graph else 2, 1, height_ratios=[1.15, 1.0, 1.5] if graph else [1.15, 1.0])
    upper, lower = parts[0], parts[1]
    if graph and keyframes is not None:
        draw_graph_on(parts[2].subplots(), keyframes)
    _draw_images(upper, references, eigen)
    panels = lower.subplots(1, 3 if confusion is not None else 2)
    _draw_kept(panels[0], eigen)
    _draw_coverage(panels[1], references.positions, places, dataset)
    if confusion is not None:
        _draw_confusion(lower, panels[2], confusion)
    return figure


def _draw_images(figure: Any, references: ReferencePanoramas, eigen: Eigenimages) -> None:
    geometry = references.geometry
    extent = (180, -180, geometry.elevation_bottom_deg, geometry.elevation_top_deg)
    axes = figure.subplots(3, 2, sharex=True, sharey=True)
    half = geometry.width // 2
    for number, panel in enumerate(axes.ravel()):
        if number > len(eigen.images):
            panel.set_visible(False)
            continue
        image = eigen.mean if number == 0 else eigen.images[number - 1]
        most = float(np.abs(image).max()) or 1.0
        low, high = (0.0, 255.0) if number == 0 else (-most, most)
        # Heading in the middle.
        panel.imshow(np.roll(image, half, axis=1), cmap="gray", vmin=low, vmax=high, extent=extent, aspect="auto")
        before = 0.0 if number < 2 else float(eigen.kept[number - 2])
        title = (
            "mean of the references"
            if number == 0
            else f"eigenimage {number}: {100 * (eigen.kept[number - 1] - before):.0f} % of the variance"
        )
        panel.set_title(title, loc="left", fontsize=9, pad=2)
        panel.set_xticks([180, 90, 0, -90, -180])
    figure.supxlabel("azimuth at heading 0, left positive [°]", fontsize=9)
    figure.supylabel("elevation [°]", fontsize=9)


def _draw_kept(axes: Axes, eigen: Eigenimages) -> None:
    axes.set_axisbelow(True)
    axes.grid(True)
    axes.plot(np.arange(1, len(eigen.kept) + 1), 100.0 * eigen.kept, color=BLUE, linewidth=1.3, marker=".", markersize=3)
    axes.set_ylim(0, 102)
    axes.set_xlabel("grey-level eigenimages")
    axes.set_ylabel("variance kept [%]")


def _draw_coverage(axes: Axes, positions: FloatArray, places: Places, dataset: Dataset | None) -> None:
    axes.set_axisbelow(True)
    axes.grid(True)
    _shade_covered(axes, places)
    if len(places) != len(positions):
        axes.plot(*places.positions.T, ".", color=VOTE_COLORS[2], markersize=2, label="places")
    axes.plot(*positions.T, "+", color=BLUE, markersize=6, label="references")
    groups: dict[str, str] = {}
    for name, drive in () if dataset is None else dataset.sequences.items():
        if drive.groundtruth is None:
            continue
        group = group_of(name)
        label = None if group in groups else group
        color = groups.setdefault(group, _COLORS[len(groups) % len(_COLORS)])
        axes.plot(*drive.groundtruth.at(drive.times)[:, :2].T, color=color, linewidth=0.9, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, handlelength=1.2, columnspacing=0.9, borderaxespad=0.1)


def _shade_covered(axes: Axes, places: Places) -> None:
    """The ground that the map holds on."""
    from matplotlib.colors import ListedColormap

    raster = places.raster
    covered = raster.weights.any(axis=1).reshape(raster.shape)
    (left, bottom), (rows, columns) = raster.origin, raster.shape
    extent = (left, left + columns * raster.cell, bottom, bottom + rows * raster.cell)
    shown = np.ma.masked_equal(covered, False)
    axes.imshow(shown, origin="lower", extent=extent, cmap=ListedColormap([VOTE_COLORS[1]]), alpha=0.5, zorder=0)


def _draw_confusion(figure: Any, axes: Axes, confusion: Confusion) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    count = len(confusion.indices)
    colors = LinearSegmentedColormap.from_list("votes", list(VOTE_COLORS))
    image = axes.imshow(100.0 * confusion.shares, cmap=colors, vmin=0, vmax=100, interpolation="nearest")
    ticks = np.unique(np.linspace(0, count - 1, min(count, 5)).round().astype(int))
    axes.set_xticks(ticks, [str(confusion.indices[tick]) for tick in ticks])
    axes.set_yticks(ticks, [str(confusion.indices[tick]) for tick in ticks])
    axes.set_xlabel("voted for: reference")
    axes.set_ylabel("image of reference")
    figure.colorbar(image, ax=axes, label="votes [% of the best]", location="bottom", shrink=0.9)

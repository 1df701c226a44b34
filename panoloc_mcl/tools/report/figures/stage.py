"""One recorded frame as a figure: the map on the left; panorama, best reference and the time that has passed on the right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation.definitions import GOOD_POSITION_M
from panoloc_mcl.tools.report.figures.scene import Shot
from panoloc_mcl.tools.report.figures.style import BLUE, INK, ORANGE, PLACES, RED, STATUS_COLORS, STATUS_INK, VOTE_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Inches that the figure is wide.
STAGE_WIDTH_IN = 9.6
# Lengths of the lines that show a heading, as shares of the map's larger side.
_POINTER, _PARTICLE = 0.07, 0.025
# Inches: the columns of map and time, what stands above and below them, and the least height of the error's axes.
_MAP_LEFT_IN, _MAP_WIDE_IN, _RIGHT_IN, _EDGE_IN, _ABOVE_IN, _BELOW_IN, _ERROR_IN = 0.5, 3.75, 5.75, 0.2, 0.75, 0.5, 1.1
# A logarithmic axis shows no zero.
_LEAST_M = 1e-3
_BLANK = np.full((2, 2), 235, dtype=np.uint8)


def draw_frame(shot: Shot, frame: int) -> Figure:
    """Everything about one frame in one figure.

    Parameters
    ----------
    shot : Shot
    frame : int
        Index of the recorded frame; -1 = before the first image.
    """
    return Stage(shot).show(frame)


class Stage:
    """A figure whose frames can be shown one after the other.

    Parameters
    ----------
    shot : Shot
    """

    def __init__(self, shot: Shot) -> None:
        from matplotlib.figure import Figure

        self.shot = shot
        low, high = shot.recording.elevation_deg
        left, right, bottom, top = shot.extent
        # Inches from the bottom up; laid out by hand, as frames must not shift against each other.
        across = STAGE_WIDTH_IN - _RIGHT_IN - _EDGE_IN
        strip = across * (high - low) / 360.0
        tall = _MAP_WIDE_IN * float(np.clip((top - bottom) / (right - left), 0.4, 1.2))
        # Two strips with their titles and labels, the band of the status, the error.
        least = 2.0 * strip + 1.6 + _ERROR_IN
        total = _BELOW_IN + max(tall, least) + _ABOVE_IN
        self.figure = Figure(figsize=(STAGE_WIDTH_IN, total), facecolor="white")

        def place(x: float, y: float, width: float, height: float) -> Axes:
            return self.figure.add_axes((x / STAGE_WIDTH_IN, y / total, width / STAGE_WIDTH_IN, height / total))

        lower = total - _ABOVE_IN - tall
        self._prepare_map(
            place(_MAP_LEFT_IN, lower, _MAP_WIDE_IN, tall), place(_MAP_LEFT_IN + _MAP_WIDE_IN + 0.1, lower, 0.13, tall)
        )
        upper = total - _ABOVE_IN - strip
        above = place(_RIGHT_IN, upper, across, strip)
        self._panorama = self._prepare_strip(above, "what the robot sees")
        above.tick_params(labelbottom=False)
        upper -= strip + 0.3
        below = place(_RIGHT_IN, upper, across, strip)
        self._reference = self._prepare_strip(below, "best reference, turned to the estimated heading")
        below.set_xlabel("azimuth, left positive [°]", labelpad=1)
        band = upper - 0.95
        self._prepare_time(place(_RIGHT_IN, band, across, 0.14), place(_RIGHT_IN, _BELOW_IN, across, band - _BELOW_IN - 0.08))
        middle = 1.0 - 0.2 / total
        self._when = self.figure.text(0.01, middle, "", ha="left", va="center", fontsize=11, fontweight="bold")
        self._badge = self.figure.text(_RIGHT_IN / STAGE_WIDTH_IN, middle, "", ha="left", va="center", fontsize=11)
        edge = 1.0 - _EDGE_IN / STAGE_WIDTH_IN
        self._off = self.figure.text(edge, middle, "", ha="right", va="center", fontsize=11)

    def show(self, frame: int) -> Figure:
        """Put a frame into the figure; -1 = before the first image."""
        shot, record = self.shot, self.shot.record
        row = shot.row(frame)
        for artist, image in ((self._panorama, shot.panorama(frame)), (self._reference, shot.reference(frame))):
            artist.set_data(_BLANK if image is None else image)
        self._votes.set_data(shot.votes(frame))
        self._show_particles(shot.particles(frame))
        self._point(self._estimate, None if frame < 0 else record.poses[row])
        self._point(self._truth, None if record.truth is None or frame < 0 else record.truth[row])
        when, off = shot.caption(frame)
        self._when.set_text(when)
        self._off.set_text(off)
        self._show_status(frame, row)
        self._show_time(-1 if frame < 0 else row)
        return self.figure

    # ---- the map ----

    def _prepare_map(self, axes: Axes, bar: Axes) -> None:
        from matplotlib.collections import LineCollection
        from matplotlib.colors import LinearSegmentedColormap

        shot = self.shot
        left, right, bottom, top = shot.extent
        self._side = max(right - left, top - bottom)
        least, most = shot.recording.vote_range
        colors = LinearSegmentedColormap.from_list("votes", list(VOTE_COLORS))
        self._votes = axes.imshow(
            shot.votes(-1), origin="lower", extent=shot.extent, cmap=colors, vmin=least, vmax=most, interpolation="nearest"
        )
        axes.plot(*shot.references.T, "+", color=PLACES, markersize=6, markeredgewidth=0.8, label="references")
        if shot.record.truth is not None:
            path = np.insert(shot.record.truth[:, :2], np.flatnonzero(shot.record.kidnapped), np.nan, axis=0)
            axes.plot(*path.T, color=INK, linewidth=0.8, linestyle=(0, (2, 2)), label="true path")
        self._headings = LineCollection([], colors=ORANGE, linewidths=0.9)
        axes.add_collection(self._headings, autolim=False)
        (self._particles,) = axes.plot([], [], ".", color=ORANGE, markersize=4.5, markeredgewidth=0.0, label="particles")
        self._truth = self._pointer(axes, INK, "truth", 13.0, filled=False)
        self._estimate = self._pointer(axes, RED, "estimate", 7.0, filled=True)
        # Equal scales by the limits alone: the box is given.
        box = axes.get_position()
        ratio = (box.height * self.figure.get_figheight()) / (box.width * self.figure.get_figwidth())
        half = 0.53 * max(right - left, (top - bottom) / ratio)
        axes.set_xlim(0.5 * (left + right) - half, 0.5 * (left + right) + half)
        axes.set_ylim(0.5 * (bottom + top) - ratio * half, 0.5 * (bottom + top) + ratio * half)
        axes.set_aspect("auto")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        self.figure.colorbar(self._votes, cax=bar, label="votes of the best heading", extend="both", extendfrac=0.02)
        _legend(axes, 5)

    def _pointer(self, axes: Axes, color: str, label: str, size: float, *, filled: bool) -> tuple[Any, Any]:
        from matplotlib.patheffects import withStroke

        face = color if filled else "none"
        # On a ground of its own, as it lies among the particles.
        (line,) = axes.plot([], [], color=color, linewidth=2.4, path_effects=[withStroke(linewidth=4.4, foreground="white")])
        (dot,) = axes.plot(
            [], [], "o", markersize=size, markeredgecolor=color, markerfacecolor=face, markeredgewidth=1.6, label=label
        )
        return line, dot

    def _point(self, pointer: tuple[Any, Any], pose: FloatArray | None) -> None:
        line, dot = pointer
        if pose is None:
            line.set_data([], [])
            dot.set_data([], [])
            return
        start, tip = _tails(pose[None], _POINTER * self._side)[0]
        line.set_data([start[0], tip[0]], [start[1], tip[1]])
        dot.set_data([pose[0]], [pose[1]])

    def _show_particles(self, particles: NDArray[np.float32]) -> None:
        self._particles.set_data(particles[:, 0], particles[:, 1])
        self._headings.set_segments(list(_tails(particles, _PARTICLE * self._side)))

    # ---- the images ----

    def _prepare_strip(self, axes: Axes, title: str) -> Any:
        low, high = self.shot.recording.elevation_deg
        image = axes.imshow(_BLANK, cmap="gray", vmin=0, vmax=255, extent=(180, -180, low, high), aspect="auto")
        axes.set_xticks([180, 90, 0, -90, -180])
        axes.set_yticks([round(low), 0, round(high)])
        axes.set_ylabel("elevation [°]", fontsize=8)
        axes.set_title(title, loc="left", fontsize=9, pad=2)
        return image

    # ---- the time that has passed ----

    def _prepare_time(self, band: Axes, below: Axes) -> None:
        record = self.shot.record
        self._seconds = record.times - record.times[0]
        period = float(np.median(np.diff(record.times))) if len(record) > 1 else 1.0
        ends = np.append(self._seconds[1:], self._seconds[-1] + period)
        self._spells = []
        named: set[str] = set()
        for start, end, status in zip(self._seconds, ends, record.status, strict=True):
            bar = band.axvspan(start, end, color=STATUS_COLORS[status], linewidth=0, label=None if status in named else status)
            named.add(status)
            self._spells.append(bar)
        band.set_yticks([])
        band.tick_params(labelbottom=False)
        band.set_ylabel("status", rotation=0, ha="right", va="center", fontsize=8, labelpad=4)
        label: str | None = "carried away"
        for axes in (band, below):
            axes.set_xlim(0.0, float(ends[-1]))
            for second in self._seconds[record.kidnapped]:
                axes.axvline(second, color=INK, linewidth=0.9, linestyle=(0, (1, 2)), label=label)
                label = None
        _legend(band, 5)
        below.set_xlabel("time since the first image [s]")
        below.set_axisbelow(True)
        below.grid(True)
        (self._error,) = below.plot([], [], color=BLUE, linewidth=1.4, marker="." if len(record) < 60 else None, markersize=5)
        error = record.position_error_m
        if error is None:
            below.set_yticks([])
            below.text(0.5, 0.5, "no ground truth", transform=below.transAxes, ha="center", va="center", color=PLACES)
            return
        self._drawn = np.maximum(error, _LEAST_M)
        below.set_yscale("log")
        below.set_ylim(0.6 * self._drawn.min(), 1.7 * max(self._drawn.max(), GOOD_POSITION_M))
        below.yaxis.set_major_formatter("{x:g}")
        below.yaxis.set_minor_formatter("")
        below.axhline(GOOD_POSITION_M, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
        below.text(
            1.0,
            GOOD_POSITION_M,
            "limit of success ",
            transform=below.get_yaxis_transform(),
            ha="right",
            va="bottom",
            fontsize=7.5,
        )
        below.set_ylabel("position error [m]", fontsize=8)

    def _show_time(self, row: int) -> None:
        """All up to a row; nothing for -1."""
        for number, bar in enumerate(self._spells):
            bar.set_visible(number <= row)
        if self.shot.record.truth is not None:
            self._error.set_data(self._seconds[: row + 1], self._drawn[: row + 1])

    def _show_status(self, frame: int, row: int) -> None:
        status = self.shot.record.status[row]
        self._badge.set_visible(frame >= 0)
        self._badge.set_text(status)
        self._badge.set_color(STATUS_INK[status])
        self._badge.set_bbox({"boxstyle": "round,pad=0.35", "linewidth": 0, "facecolor": STATUS_COLORS[status]})


def _tails(poses: NDArray[Any], length: float) -> NDArray[np.float64]:
    """Lines from poses along their headings: float64 (n, 2, 2)."""
    start = poses[:, :2].astype(np.float64)
    return np.stack([start, start + length * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])], axis=1)


def _legend(axes: Axes, columns: int) -> None:
    """Above the axes, from their left edge on."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.2,
        ncols=columns,
        handlelength=1.5,
        columnspacing=0.9,
        handletextpad=0.4,
    )

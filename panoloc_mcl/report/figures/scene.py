"""One recorded frame: panorama, best reference, and the map with votes, particles, estimate and truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.evaluation import SequenceRecord
from panoloc_mcl.geometry import FloatArray
from panoloc_mcl.report import layout
from panoloc_mcl.report.figures.style import INK, ORANGE, PLACES, RED, VOTE_COLORS
from panoloc_mcl.report.page import grid_of
from panoloc_mcl.report.recording import Recording
from panoloc_mcl.report.results_reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Length of the line that shows a heading, as a share of the map's larger side.
_POINTER = 0.06
# Inches around and between the parts of the figure.
_LEFT_IN, _RIGHT_IN, _BAR_IN, _BELOW_IN = 0.62, 0.22, 0.8, 0.5


@dataclass(frozen=True, eq=False)
class Shot:
    """A run with its recorded frames.

    Parameters
    ----------
    record : SequenceRecord
    recording : Recording
    references : float64 (n, 2)
        Positions, metres.
    """

    record: SequenceRecord
    recording: Recording
    references: FloatArray

    @classmethod
    def of(cls, results: Results, record: SequenceRecord) -> Shot:
        """A run of a results folder.

        Raises
        ------
        ResultsError
            No frames were recorded, or they are damaged.
        """
        folder = results.path / layout.run_folder(record.name, record.run)
        return cls(record, Recording.load(folder / layout.FRAMES), results.place_positions)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the map, metres."""
        (x, y, step), grid = grid_of(self.recording.places, self.recording.spacing)
        rows, columns = grid.shape
        return x - 0.5 * step, x + (columns - 0.5) * step, y - 0.5 * step, y + (rows - 0.5) * step

    def votes(self, frame: int) -> NDArray[np.float64]:
        """Votes as a picture with the bottom row first, NaN off the map; 0 before the first image (frame -1)."""
        _, grid = grid_of(self.recording.places, self.recording.spacing)
        field = np.zeros(len(self.recording.places)) if frame < 0 else self.recording.field(frame)
        return np.where(grid < 0, np.nan, field[grid])

    def particles(self, frame: int) -> NDArray[np.float32]:
        """Of a frame; those before the first image for -1."""
        return self.recording.prior if frame < 0 else self.recording.particles[frame]

    def caption(self, frame: int) -> str:
        """What to say of a frame."""
        if frame < 0:
            return "before the first image"
        row = int(self.recording.rows[frame])
        record = self.record
        text = f"{record.times[row] - record.times[0]:.1f} s, {record.status[row]}"
        if record.position_error_m is None or record.heading_error_deg is None:
            return text
        return f"{text}, off by {_metres(record.position_error_m[row])}, {record.heading_error_deg[row]:.2f}°"

    def panorama(self, frame: int) -> NDArray[np.uint8] | None:
        """What the robot saw, ahead in the middle."""
        return None if frame < 0 else _turned(self.recording.panoramas[frame], 0.0)

    def reference(self, frame: int) -> NDArray[np.uint8] | None:
        """The best reference, turned to the estimated heading."""
        if frame < 0:
            return None
        row = int(self.recording.rows[frame])
        image = self.recording.references.get(int(self.record.best_place[row]), b"")
        return _turned(image, float(self.record.poses[row, 2]))


def draw_frame(shot: Shot, frame: int, width_in: float = 6.4) -> Figure:
    """Everything about one frame in one figure.

    Parameters
    ----------
    shot : Shot
    frame : int
        Index of the recorded frame; -1 = before the first image.
    width_in : float
        Inches.
    """
    return Stage(shot, width_in).show(frame)


class Stage:
    """A figure whose frames can be shown one after the other.

    Parameters
    ----------
    shot : Shot
    width_in : float
        Inches.
    """

    def __init__(self, shot: Shot, width_in: float = 6.4) -> None:
        from matplotlib.figure import Figure

        self.shot = shot
        low, high = shot.recording.elevation_deg
        left, right, bottom, top = shot.extent
        # Inches from the bottom up; laid out by hand, as frames must not shift against each other.
        across = width_in - _LEFT_IN - _RIGHT_IN
        strip = across * (high - low) / 360.0
        wide = across - _BAR_IN
        tall = float(np.clip(wide * (top - bottom) / (right - left), 0.4 * wide, 1.1 * wide))
        lower, middle = _BELOW_IN, _BELOW_IN + tall + 0.85
        upper = middle + strip + 0.3
        total = upper + strip + 0.55
        self.figure = Figure(figsize=(width_in, total), facecolor="white")

        def place(x: float, y: float, width: float, height: float) -> Axes:
            return self.figure.add_axes((x / width_in, y / total, width / width_in, height / total))

        above = place(_LEFT_IN, upper, across, strip)
        self._panorama = self._prepare_strip(above, "what the robot sees")
        above.tick_params(labelbottom=False)
        below = place(_LEFT_IN, middle, across, strip)
        self._reference = self._prepare_strip(below, "best reference, turned to the estimated heading")
        below.set_xlabel("azimuth, left positive [°]", labelpad=1)
        self._prepare_map(place(_LEFT_IN, lower, wide, tall), place(_LEFT_IN + wide + 0.12, lower, 0.15, tall))

    def show(self, frame: int) -> Figure:
        """Put a frame into the figure; -1 = before the first image."""
        shot = self.shot
        for artist, image in ((self._panorama, shot.panorama(frame)), (self._reference, shot.reference(frame))):
            artist.set_data(np.full((2, 2), 235, dtype=np.uint8) if image is None else image)
        self._votes.set_data(shot.votes(frame))
        particles = shot.particles(frame)
        self._particles.set_data(particles[:, 0], particles[:, 1])
        row = int(shot.recording.rows[max(frame, 0)])
        self._point(self._estimate, None if frame < 0 else shot.record.poses[row])
        truth = shot.record.truth
        self._point(self._truth, None if truth is None or frame < 0 else truth[row])
        self.figure.suptitle(f"{shot.record.name}: {shot.caption(frame)}", x=0.02, y=0.995, ha="left", va="top", fontsize=10)
        return self.figure

    def _prepare_strip(self, axes: Axes, title: str) -> Any:
        low, high = self.shot.recording.elevation_deg
        blank = np.full((2, 2), 235, dtype=np.uint8)
        image = axes.imshow(blank, cmap="gray", vmin=0, vmax=255, extent=(180, -180, low, high), aspect="auto")
        axes.set_xticks([180, 90, 0, -90, -180])
        axes.set_yticks([round(low), 0, round(high)])
        axes.set_ylabel("elevation [°]")
        axes.set_title(title, loc="left", fontsize=9, pad=2)
        return image

    def _prepare_map(self, axes: Axes, bar: Axes) -> None:
        from matplotlib.colors import LinearSegmentedColormap

        shot = self.shot
        left, right, bottom, top = shot.extent
        self._length = _POINTER * max(right - left, top - bottom)
        most = float(max(shot.recording.peaks.max(initial=0.0), 1e-6))
        colors = LinearSegmentedColormap.from_list("votes", list(VOTE_COLORS))
        self._votes = axes.imshow(
            shot.votes(-1), origin="lower", extent=shot.extent, cmap=colors, vmin=0.0, vmax=most, interpolation="nearest"
        )
        axes.plot(*shot.references.T, "+", color=PLACES, markersize=6, markeredgewidth=0.8, label="references")
        if shot.record.truth is not None:
            path = np.insert(shot.record.truth[:, :2], np.flatnonzero(shot.record.kidnapped), np.nan, axis=0)
            axes.plot(*path.T, color=INK, linewidth=0.7, linestyle=(0, (2, 2)), label="true path")
        (self._particles,) = axes.plot([], [], ".", color=ORANGE, markersize=3.5, alpha=0.8, label="particles")
        self._truth = self._pointer(axes, INK, "truth", 11.0, filled=False)
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
        self.figure.colorbar(self._votes, cax=bar, label="votes of the best heading")
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.2,
            ncols=5,
            handlelength=1.3,
            columnspacing=1.1,
            handletextpad=0.5,
        )

    def _pointer(self, axes: Axes, color: str, label: str, size: float, *, filled: bool) -> tuple[Any, Any]:
        face = color if filled else "none"
        (line,) = axes.plot([], [], color=color, linewidth=2.0)
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
        tip = pose[:2] + self._length * np.array([np.cos(pose[2]), np.sin(pose[2])])
        line.set_data([pose[0], tip[0]], [pose[1], tip[1]])
        dot.set_data([pose[0]], [pose[1]])


def _turned(image: bytes, heading: float) -> NDArray[np.uint8] | None:
    """A recorded panorama as a robot at a heading sees it, ahead in the middle; None where there is no image."""
    if not image:
        return None
    pixels = cv2.imdecode(np.frombuffer(image, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        return None
    columns = pixels.shape[1]
    return np.asarray(np.roll(pixels, round(columns * (0.5 + heading / (2.0 * np.pi))), axis=1), dtype=np.uint8)


def _metres(value: float) -> str:
    if value >= 1.0:
        return f"{value:.2f} m"
    return f"{100.0 * value:.1f} cm" if value >= 0.01 else f"{1000.0 * value:.1f} mm"

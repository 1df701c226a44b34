"""What there is to show of one recorded frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.report.highlights import metres
from panoloc_mcl.tools.report.pages.page import grid_of
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.report.results.recording import Recording
from panoloc_mcl.tools.report.results.results_reader import Results


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

    def row(self, frame: int) -> int:
        """Of ``steps.csv``; that of the first image for -1."""
        return int(self.recording.rows[max(frame, 0)])

    def caption(self, frame: int) -> tuple[str, str]:
        """When a frame was, and how far off its estimate is (empty without truth)."""
        if frame < 0:
            return f"{self.record.name}, before the first image", ""
        row, record = self.row(frame), self.record
        when = f"{record.name}, image {row + 1} of {len(record)}, {record.times[row] - record.times[0]:.1f} s"
        if record.kidnapped[row]:
            when += ": carried away"
        if record.position_error_m is None or record.heading_error_deg is None or not record.has_truth[row]:
            return when, ""
        return when, f"off by {metres(record.position_error_m[row])}, {record.heading_error_deg[row]:.1f}°"

    def panorama(self, frame: int) -> NDArray[np.uint8] | None:
        """What the robot saw, ahead in the middle."""
        return None if frame < 0 else _turned(self.recording.panoramas[frame], 0.0)

    def reference(self, frame: int) -> NDArray[np.uint8] | None:
        """The best reference, turned to the estimated heading."""
        if frame < 0:
            return None
        row = self.row(frame)
        image = self.recording.references.get(int(self.record.best_place[row]), b"")
        return _turned(image, float(self.record.poses[row, 2]))


def _turned(image: bytes, heading: float) -> NDArray[np.uint8] | None:
    """A recorded panorama as a robot at a heading sees it, ahead in the middle; None where there is no image."""
    if not image:
        return None
    pixels = cv2.imdecode(np.frombuffer(image, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        return None
    columns = pixels.shape[1]
    return np.asarray(np.roll(pixels, round(columns * (0.5 + heading / (2.0 * np.pi))), axis=1), dtype=np.uint8)

"""The sink that keeps frames of a run and writes them into its results folder."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.observation import VoteField
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.report.results.recording import FULL, Recording, thinned
from panoloc_mcl.tools.report.sinks import Departure, Frame, Scene

#: Frames that are kept of all sequences together; of more, every second, third, … is.
MOST_FRAMES = 600
#: Particles that are kept of a frame.
MOST_PARTICLES = 300
#: Headings that votes are kept for.
HEADINGS = 360
_JPEG_QUALITY = 72


class FrameRecorder:
    """Records the first run over each sequence.

    Parameters
    ----------
    folder : Path, optional
        Results folder that each `Recording` is written to when its sequence is over. Without one it is only kept in `recording`.
    most_frames : int
        Of all sequences together.

    Attributes
    ----------
    recording : Recording or None
        Of the sequence that ended last.
    """

    def __init__(self, folder: Path | None = None, most_frames: int = MOST_FRAMES) -> None:
        self.recording: Recording | None = None
        self._folder = folder
        self._most_frames = most_frames

    def open(self, scene: Scene) -> None:
        """Find out how many frames there will be."""
        self._scene = scene
        self._every = max(1, -(-sum(scene.images) // self._most_frames))

    def begin(self, departure: Departure) -> None:
        """Keep the belief before the first image."""
        self._active = departure.run == 0
        self._prior = thinned(departure.particles, departure.weights, MOST_PARTICLES)
        self._rows: list[int] = []
        self._panoramas: list[bytes] = []
        self._votes: list[NDArray[np.uint8]] = []
        self._heading_votes: list[NDArray[np.uint8]] = []
        self._peaks: list[float] = []
        self._particles: list[NDArray[np.float32]] = []
        self._references: dict[int, bytes] = {}

    def take(self, frame: Frame) -> None:
        """Keep one frame."""
        if not self._active or frame.row % self._every:
            return
        votes, heading_votes, peak = _best_votes(frame.estimate.vote_field, len(self._scene.places))
        best = frame.estimate.best_place
        if best >= 0 and best not in self._references:
            self._references[best] = _jpeg(self._scene.references.pixels[best])
        self._rows.append(frame.row)
        self._panoramas.append(b"" if frame.panorama is None else _jpeg(frame.panorama))
        self._votes.append(votes)
        self._heading_votes.append(heading_votes)
        self._peaks.append(peak)
        self._particles.append(thinned(frame.particles, frame.weights, MOST_PARTICLES))

    def end(self, record: SequenceRecord) -> None:
        """Write what was kept.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        if not self._active:
            return
        geometry = self._scene.references.geometry
        self.recording = Recording(
            rows=np.array(self._rows, dtype=np.int64),
            panoramas=tuple(self._panoramas),
            places=self._scene.places.positions,
            spacing=self._scene.places.spacing,
            votes=np.array(self._votes, dtype=np.uint8).reshape(len(self._rows), -1),
            heading_votes=np.array(self._heading_votes, dtype=np.uint8).reshape(len(self._rows), -1),
            peaks=np.array(self._peaks),
            prior=self._prior,
            particles=np.array(self._particles, dtype=np.float32).reshape(len(self._rows), -1, 3),
            references=self._references,
            elevation_deg=(geometry.elevation_bottom_deg, geometry.elevation_top_deg),
        )
        if self._folder is not None:
            self.recording.save(self._folder / layout.run_folder(record.name, record.run) / layout.FRAMES)

    def close(self) -> None:
        """Nothing is left open."""


def _best_votes(field: VoteField | None, places: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8], float]:
    """Most votes of each place and of each heading in bytes, and what the largest of them stands for."""
    peak = 0.0 if field is None or not field.informative else float(field.votes.max())
    if field is None or peak <= 0.0:
        return np.zeros(places, dtype=np.uint8), np.zeros(HEADINGS, dtype=np.uint8), 0.0
    return _in_bytes(field.best_of_places, peak), _in_bytes(_over_headings(field), peak), peak


def _over_headings(field: VoteField) -> FloatArray:
    """Most votes over the places for `HEADINGS` headings, counter-clockwise from 0; 0 where nothing was asked."""
    best = field.votes.max(axis=1).astype(np.float64)
    if field.full_circle:
        asked = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
        return np.asarray(np.interp(asked, field.headings, best, period=2.0 * np.pi), dtype=np.float64)
    votes = np.zeros(HEADINGS)
    np.maximum.at(votes, np.rint(field.headings / (2.0 * np.pi) * HEADINGS).astype(np.int64) % HEADINGS, best)
    return votes


def _in_bytes(votes: NDArray[np.floating], peak: float) -> NDArray[np.uint8]:
    return np.asarray(np.rint(votes * (FULL / peak)), dtype=np.uint8)


def _jpeg(pixels: NDArray[np.uint8]) -> bytes:
    return bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes())

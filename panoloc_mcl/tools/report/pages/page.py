"""What the report's page is told of each run: plain values and packed bytes, ready for JSON."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.report.results.recording import Recording
from panoloc_mcl.tools.report.results.steps import STAGE_PREFIX, TOTAL, read_figures, read_messages

# More points only make the page slow; errors then are the largest of each bin.
_MOST_POINTS = 3000
_MOST_CELLS = 6000
# Of 16-bit coordinates: the largest number.
_STEPS = 65535


def run_data(record: SequenceRecord, folder: Path) -> dict[str, Any]:
    """Everything that the page shows of one run.

    Parameters
    ----------
    record : SequenceRecord
    folder : Path
        Results folder.

    Raises
    ------
    ResultsError
        Its steps or its recorded frames are damaged.
    """
    within = folder / layout.run_folder(record.name, record.run)
    every = -(-len(record) // _MOST_POINTS)
    rows = np.arange(0, len(record), every)
    steps = read_figures(within / layout.STEPS)
    frames = within / layout.FRAMES
    truth = record.truth
    return {
        "title": f"{record.name}, run {record.run}",
        "seconds": _numbers(record.times[rows] - record.times[0], 3),
        "pose": _poses(record.poses[rows]),
        "truth": None if truth is None else _poses(truth[rows]),
        "status": [record.status[row] for row in rows],
        "position_error": _largest(record.position_error_m, rows, 5),
        "heading_error": _largest(record.heading_error_deg, rows, 4),
        "position_claimed": _largest(_claimed_sd(record, 0), rows, 5),
        "heading_claimed": _largest(_claimed_sd(record, 1), rows, 4),
        "teleports": _numbers(record.times[record.kidnapped] - record.times[0], 3),
        "n_eff": _numbers(steps["n_eff"][rows], 1),
        "particles": _numbers(steps["particles"][rows], 0),
        "stages": {
            name.removeprefix(STAGE_PREFIX): _numbers(column[rows], 3)
            for name, column in steps.items()
            if name.startswith(STAGE_PREFIX) and name != TOTAL
        },
        "recording": _recording_data(Recording.load(frames), record, read_messages(within / layout.STEPS))
        if frames.exists()
        else None,
    }


def _recording_data(recording: Recording, record: SequenceRecord, messages: Sequence[str]) -> dict[str, Any]:
    rows = recording.rows
    low, high = _bounds(recording, record)
    (x, y, step), grid = grid_of(recording.places, recording.spacing)
    position, heading = record.position_error_m, record.heading_error_deg
    return {
        "seconds": _numbers(record.times[rows] - record.times[0], 3),
        "pose": _poses(record.poses[rows]),
        "truth": None if record.truth is None else _poses(record.truth[rows]),
        "status": [record.status[row] for row in rows],
        "message": [messages[row] for row in rows],
        "position_error": None if position is None else _numbers(position[rows], 5),
        "heading_error": None if heading is None else _numbers(heading[rows], 4),
        "best_place": record.best_place[rows].tolist(),
        "elevation_deg": list(recording.elevation_deg),
        "panoramas": [_text(image) for image in recording.panoramas],
        "references": {str(index): _text(image) for index, image in recording.references.items()},
        "raster": {"x": x, "y": y, "step": step, "rows": grid.shape[0], "columns": grid.shape[1]},
        "on_map": _text((grid >= 0).astype(np.uint8).tobytes()),
        "votes": _text(recording.votes[:, grid.ravel()].tobytes()),
        "heading_votes": _text(recording.heading_votes.tobytes()),
        "headings": recording.heading_votes.shape[1],
        "peaks": _numbers(recording.peaks, 5),
        "vote_range": list(recording.vote_range),
        "bounds": [*low.tolist(), *high.tolist()],
        "prior": _text(_packed(recording.prior, low, high)),
        "particles": _text(_packed(recording.particles, low, high)),
        "particle_count": len(recording.prior),
    }


def grid_of(places: FloatArray, spacing: float) -> tuple[tuple[float, float, float], NDArray[np.int64]]:
    """A raster over the places: those on a grid have a cell each, others the cells around them.

    Parameters
    ----------
    places : float64 (k, 2)
        Metres.
    spacing : float
        Of neighbours, metres.

    Returns
    -------
    (x, y, step) : float
        Centre of the first cell and width of all, metres.
    grid : int64 (rows, columns)
        Place that each cell belongs to, -1 for none.
    """
    low, high = places.min(axis=0), places.max(axis=0)
    offsets = (places - low) / spacing
    on_grid = np.mean(np.abs(offsets - np.rint(offsets)) < 0.05) > 0.95
    step = spacing if on_grid else spacing / 4.0
    margin = 0.0 if on_grid else 0.5 * spacing
    area = float(np.prod(high - low + 2.0 * margin + step))
    step = max(step, float(np.sqrt(area / _MOST_CELLS)))
    columns, rows = (int(count) for count in np.rint((high - low + 2.0 * margin) / step).astype(np.int64) + 1)
    x, y = (low[axis] - margin + step * np.arange(count) for axis, count in enumerate((columns, rows)))
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    distance, nearest = cKDTree(places).query(centres)
    grid = np.where(distance <= 0.75 * max(spacing, step), nearest, -1).reshape(rows, columns)
    return (float(x[0]), float(y[0]), float(step)), np.asarray(grid, dtype=np.int64)


def _bounds(recording: Recording, record: SequenceRecord) -> tuple[FloatArray, FloatArray]:
    """Of all that is shown on the map; particles outside are put on its edge."""
    drawn = [recording.places, record.poses[recording.rows, :2]]
    if record.truth is not None:
        drawn.append(record.truth[record.has_truth, :2])
    points = np.concatenate(drawn)
    return points.min(axis=0) - 1.5 * recording.spacing - 0.25, points.max(axis=0) + 1.5 * recording.spacing + 0.25


def _packed(particles: NDArray[np.float32], low: FloatArray, high: FloatArray) -> bytes:
    """x, y and heading of each particle as three numbers of 16 bits: over the bounds, and over the circle."""
    shares = np.empty(particles.shape)
    shares[..., :2] = (particles[..., :2] - low) / (high - low)
    shares[..., 2] = np.mod(particles[..., 2] / (2.0 * np.pi), 1.0)
    return np.rint(np.clip(shares, 0.0, 1.0) * _STEPS).astype("<u2").tobytes()


def _poses(poses: FloatArray) -> dict[str, list[float | None]]:
    heading = np.degrees(np.arctan2(np.sin(poses[:, 2]), np.cos(poses[:, 2])))
    return {"x": _numbers(poses[:, 0], 4), "y": _numbers(poses[:, 1], 4), "heading": _numbers(heading, 3)}


def _claimed_sd(record: SequenceRecord, axis: int) -> FloatArray | None:
    """Claimed standard deviation of every frame: of the position along its longest axis, metres (0), or of the heading, degrees (1)."""
    if record.covariances is None:
        return None
    if axis == 1:
        return np.degrees(np.sqrt(np.maximum(record.covariances[:, 2, 2], 0.0)))
    xx, xy, yy = (record.covariances[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    return np.sqrt(np.maximum(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy), 0.0))


def _largest(values: FloatArray | None, rows: NDArray[np.int64], decimals: int) -> list[float | None] | None:
    return None if values is None else _numbers(np.fmax.reduceat(values, rows), decimals)


def _numbers(values: FloatArray, decimals: int) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in np.round(values, decimals)]


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")

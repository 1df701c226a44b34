"""Trajectories of other programs: TUM files in, the figures that a trajectory can have out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import DatasetError, ResultsError
from panoloc_mcl.tools.datasets import read_tum, truth_at
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate

_ROUNDING_S = 1e-6


def record_of_tum(estimate: Path, truth: Path) -> tuple[SequenceRecord, int]:
    """A foreign trajectory as a record: every pose counts as sure, the truth is read linearly between its stamps.

    Parameters
    ----------
    estimate, truth : Path
        TUM files by one clock and in one frame.

    Returns
    -------
    record : SequenceRecord
    left_out : int
        Poses before or after all of the truth.

    Raises
    ------
    ResultsError
        Files that cannot be read, one line a fault, or whose time stamps have nothing in common.
    """
    try:
        poses, true = read_tum(estimate), read_tum(truth)
    except DatasetError as error:
        raise ResultsError(error.faults) from error
    first, last = true.times[0] - _ROUNDING_S, true.times[-1] + _ROUNDING_S
    inside = (poses.times >= first) & (poses.times <= last)
    if not inside.any():
        raise ResultsError(
            f"{estimate}: covers {poses.times[0]:.3f} to {poses.times[-1]:.3f} s, {truth} {true.times[0]:.3f} to "
            f"{true.times[-1]:.3f} s: nothing in common; bring both to one clock"
        )
    count = int(inside.sum())
    times = poses.times[inside]
    record = SequenceRecord(
        name=estimate.stem,
        run=0,
        times=times,
        poses=poses.poses[inside],
        truth=truth_at(true, times),
        status=("converged",) * count,
        best_place=np.full(count, -1),
        step_ms=np.full(count, np.nan),
        kidnapped=np.zeros(count, dtype=np.bool_),
    )
    return record, len(poses) - count


def evaluate_tum(record: SequenceRecord) -> dict[str, Any]:
    """The figures of a foreign trajectory; what only a status could tell is None."""
    metrics = evaluate([record], None)
    for part in (metrics["overall"], *metrics["groups"].values(), *metrics["sequences"].values()):
        for name in ("frames_to_converge_median", "seconds_to_converge_median"):
            part[name] = None
        for name in ("global_success", "false_convergence"):
            part[name] = dict.fromkeys(part[name])
    return metrics

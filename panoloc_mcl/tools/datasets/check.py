"""The thorough check of a data set: everything the reader finds, and what only decoding and comparing can tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.datasets.dataset import Sequence
from panoloc_mcl.tools.datasets.reader import scan_dataset
from panoloc_mcl.tools.datasets.trajectory import Trajectory, truth_at

_SLACK_S = 1.0  # frames may lie this far outside a trajectory
_SAME_PLACE_M = 1e-3
# Frames' times over a trajectory's.
_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
# What a trajectory may have been written as instead of its TUM file.
_TABLES = (".csv", ".txt", ".tum", ".tsv", ".dat")


def check_dataset(path: str | Path) -> list[str]:
    """Check a data set and decode every image in it.

    Parameters
    ----------
    path : str or Path
        The folder.

    Returns
    -------
    list of str
        One line a fault: file, row or key, value and remedy. Empty for a good data set.
    """
    scan = scan_dataset(Path(path))
    faults = list(scan.faults)
    if scan.references is not None:
        faults += _undecodable(scan.references) + _one_place(scan.references)
    for sequence in scan.sequences:
        faults += _undecodable(sequence) + _unread(sequence)
        faults += _uncovered(sequence, sequence.odometry, "odometry.tum")
        # Frames without truth are welcome, they are not judged; truth without frames is of another clock.
        if sequence.groundtruth is not None and not np.isfinite(truth_at(sequence.groundtruth, sequence.times)).any():
            faults += _uncovered(sequence, sequence.groundtruth, "groundtruth.tum")
    # Both trajectories may say the same of the frames.
    return list(dict.fromkeys(faults))


def _undecodable(images: References | Sequence) -> list[str]:
    faults: list[str] = []
    for file in images.files:
        try:
            read_image(file)
        except ImageError as error:
            faults.extend(error.faults)
    return faults


def _one_place(references: References) -> list[str]:
    places = references.poses[:, :2]
    if len(places) < 2 or np.ptp(places, axis=0).max() > _SAME_PLACE_M:
        return []
    return [f"{references.path / 'poses.csv'}: all {len(places)} images have one place; write where each was taken"]


def _unread(sequence: Sequence) -> list[str]:
    """Trajectories that nobody reads, because they have another name."""
    faults = []
    for name, known in (("odometry", sequence.odometry), ("groundtruth", sequence.groundtruth)):
        others = [
            file for file in sorted(sequence.path.glob("*.*")) if file.stem.lower() == name and file.suffix.lower() in _TABLES
        ]
        if known is None and others:
            faults.append(f"{others[0]}: is not read; write it as {name}.tum, lines of 'timestamp tx ty tz qx qy qz qw'")
    return faults


def _uncovered(sequence: Sequence, trajectory: Trajectory | None, name: str) -> list[str]:
    if trajectory is None:
        return []
    start, end = trajectory.times[0], trajectory.times[-1]
    outside = int(np.count_nonzero((sequence.times < start - _SLACK_S) | (sequence.times > end + _SLACK_S)))
    if not outside:
        return []
    for factor, unit in _UNITS.items():
        as_long = np.ptp(sequence.times) > 0.2 * factor * (end - start)
        if as_long and np.all((sequence.times >= factor * (start - _SLACK_S)) & (sequence.times <= factor * (end + _SLACK_S))):
            first = f"{sequence.times[0]:.0f} to {sequence.times[-1]:.0f}"
            return [
                f"{sequence.path / 'frames.csv'}: time stamps {first} look like {unit} beside its trajectories; write seconds"
            ]
    return [
        f"{sequence.path / name}: covers {start:.3f} to {end:.3f} s, but {outside} of {len(sequence)} frames "
        f"({sequence.times[0]:.3f} to {sequence.times[-1]:.3f} s) lie outside; use one clock for both, or drop those frames"
    ]

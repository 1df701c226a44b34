"""The thorough check of a data set: everything the reader finds, and what only decoding and comparing can tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoloc_mcl.datasets.dataset import References, Sequence
from panoloc_mcl.datasets.images import read_image
from panoloc_mcl.datasets.reader import scan_dataset
from panoloc_mcl.datasets.trajectory import Trajectory
from panoloc_mcl.errors import ImageError
from panoloc_mcl.geometry import angle_difference

_SAME_PLACE_M = 1e-3
_SAME_HEADING = 1e-3  # radians
_SLACK_S = 1.0  # frames may lie this far outside a trajectory


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
        faults += _undecodable(scan.references)
        faults += same_poses(scan.references)
    for sequence in scan.sequences:
        faults += _undecodable(sequence)
        faults += _uncovered(sequence, sequence.odometry, "odometry.tum")
        faults += _uncovered(sequence, sequence.groundtruth, "groundtruth.tum")
    return faults


def _undecodable(images: References | Sequence) -> list[str]:
    faults: list[str] = []
    for file in images.files:
        try:
            read_image(file)
        except ImageError as error:
            faults.extend(error.faults)
    return faults


def same_poses(references: References) -> list[str]:
    """One line for each two references at one position and heading, within 1 mm and 1 mrad.

    Several headings at one position are several views of it, and welcome.
    """
    # Slow to import, and only the check needs it.
    from scipy.spatial import cKDTree

    faults = []
    poses = references.poses
    for first, second in sorted(cKDTree(poses[:, :2]).query_pairs(_SAME_PLACE_M)):
        if abs(float(angle_difference(poses[first, 2], poses[second, 2]))) < _SAME_HEADING:
            faults.append(
                f"{references.path / 'poses.csv'}: {references.files[first].name} and {references.files[second].name} "
                f"have the same pose ({poses[first, 0]:g}, {poses[first, 1]:g}, {poses[first, 2]:g}); keep one of them"
            )
    return faults


def _uncovered(sequence: Sequence, trajectory: Trajectory | None, name: str) -> list[str]:
    if trajectory is None:
        return []
    start, end = trajectory.times[0], trajectory.times[-1]
    outside = int(np.count_nonzero((sequence.times < start - _SLACK_S) | (sequence.times > end + _SLACK_S)))
    if not outside:
        return []
    return [
        f"{sequence.path / name}: covers {start:.3f} to {end:.3f} s, but {outside} of {len(sequence)} frames "
        f"({sequence.times[0]:.3f} to {sequence.times[-1]:.3f} s) lie outside; use one clock for both, or drop those frames"
    ]

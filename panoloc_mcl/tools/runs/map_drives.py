"""Drives of a data set, as a map is made of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.map.drives import Drive
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets import Sequence as Recorded


def drives_of(dataset: Dataset, names: Sequence[str]) -> tuple[list[Drive], list[str]]:
    """Drives by names or globs, in this order, with what the user should know of them.

    Raises
    ------
    DatasetError
        A name that fits none; a drive without odometry, or whose odometry covers none of its images.
    """
    selected = {drive.name: drive for name in names for drive in dataset.select([name])}
    drives, notes, faults = [], [], []
    for recorded in selected.values():
        if recorded.odometry is None:
            faults.append(f"{recorded.path}: has no odometry; a map from a drive needs odometry.tum (wheels, visual odometry)")
            continue
        covered = _covered(recorded)
        if not len(covered):
            faults.append(f"{recorded.path / 'odometry.tum'}: covers none of the images; bring both to one clock")
            continue
        if len(covered) < len(recorded):
            notes.append(f"drive {recorded.name}: {len(recorded) - len(covered)} images beyond its odometry are left out")
        times = recorded.times[covered]
        files = tuple(recorded.files[index] for index in covered)
        odometry = recorded.odometry.at(times)
        drives.append(Drive(recorded.name, files, times, odometry, recorded.camera, recorded.image_size))
    if faults:
        raise DatasetError(faults)
    return drives, notes


def _covered(recorded: Recorded) -> np.ndarray:
    """Images within the time of odometry, and a moment around it."""
    assert recorded.odometry is not None
    times, slack = recorded.odometry.times, 0.5
    return np.flatnonzero((recorded.times >= times[0] - slack) & (recorded.times <= times[-1] + slack))

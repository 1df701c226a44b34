"""References taken from a drive whose poses are known: nobody has to survey places by hand."""

from __future__ import annotations

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.datasets.dataset import Sequence


def references_from(drive: Sequence, every_m: float) -> References:
    """The images of a drive that lie apart from each other, at their true poses.

    Parameters
    ----------
    drive : Sequence
    every_m : float
        Least distance of a reference from all before it, metres.

    Raises
    ------
    DatasetError
        The drive has no ground truth, or it covers none of the images.
    """
    truth = drive.groundtruth
    if truth is None:
        raise DatasetError(f"references.from = {drive.name}: has no true poses; name a drive with ground truth, or set map")
    kept: list[int] = []
    positions = np.empty((0, 2))
    # Before its first and after its last stamp, the truth would be extrapolated.
    for index in np.flatnonzero((drive.times >= truth.times[0]) & (drive.times <= truth.times[-1])).tolist():
        position = truth.at(drive.times[index])[:2]
        if not len(kept) or np.hypot(*(positions - position).T).min() >= every_m:
            kept.append(index)
            positions = np.vstack([positions, position])
    if not kept:
        raise DatasetError(f"references.from = {drive.name}: its true poses cover none of its images; bring both to one clock")
    files = tuple(drive.files[index] for index in kept)
    return References(drive.path, files, truth.at(drive.times[kept]), drive.camera, drive.image_size)

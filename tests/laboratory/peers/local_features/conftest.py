from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.tools.datasets import read_dataset, read_image, resolve_dataset


@pytest.fixture(scope="session")
def corner():
    """Nine references of the embedded hall, and the images of its drives that were taken among them, with their poses."""
    dataset = read_dataset(resolve_dataset("hall"))
    poses = dataset.references.poses
    near = np.flatnonzero((poses[:, 0] <= 2.01) & (poses[:, 1] <= 2.01))
    references = read_references(replace(dataset.references.of(near)))
    frames = []
    for drive in dataset.sequences.values():
        unwrap = Unwrapper(drive.camera, drive.image_size, references.geometry)
        for time, file in zip(drive.times, drive.files, strict=True):
            pose = drive.groundtruth.at(np.array([time]))[0]
            if np.all((pose[:2] > 0.1) & (pose[:2] < 1.9)):
                frames.append((unwrap(read_image(file)), pose))
    assert len(frames) >= 3
    return references, frames[:: max(1, len(frames) // 4)]

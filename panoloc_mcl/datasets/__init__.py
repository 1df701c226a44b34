"""Data sets: reading, checking and writing them, and one that comes with the package."""

from panoloc_mcl.datasets.check import check_dataset, same_poses
from panoloc_mcl.datasets.dataset import Dataset, References, Sequence
from panoloc_mcl.datasets.embedded import EMBEDDED, resolve_dataset
from panoloc_mcl.datasets.images import image_size, read_image, write_image
from panoloc_mcl.datasets.reader import read_dataset
from panoloc_mcl.datasets.trajectory import Trajectory, read_tum, write_tum
from panoloc_mcl.datasets.writer import DatasetWriter, copy_dataset

__all__ = [
    "EMBEDDED",
    "Dataset",
    "DatasetWriter",
    "References",
    "Sequence",
    "Trajectory",
    "check_dataset",
    "copy_dataset",
    "image_size",
    "read_dataset",
    "read_image",
    "read_tum",
    "resolve_dataset",
    "same_poses",
    "write_image",
    "write_tum",
]

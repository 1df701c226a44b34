"""Data sets: reading, checking and writing them, and one that comes with the package."""

from panoloc_mcl.robot.images import image_size, read_image, write_image
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.datasets.check import check_dataset
from panoloc_mcl.tools.datasets.dataset import Dataset, Sequence
from panoloc_mcl.tools.datasets.embedded import EMBEDDED, resolve_dataset
from panoloc_mcl.tools.datasets.reader import read_dataset
from panoloc_mcl.tools.datasets.references.from_map import keyframe_trajectory, write_map_as_dataset
from panoloc_mcl.tools.datasets.trajectory import Trajectory, read_tum, truth_at, write_tum
from panoloc_mcl.tools.datasets.writer import DatasetWriter, copy_dataset

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
    "keyframe_trajectory",
    "read_dataset",
    "read_image",
    "read_tum",
    "resolve_dataset",
    "truth_at",
    "write_image",
    "write_map_as_dataset",
    "write_tum",
]

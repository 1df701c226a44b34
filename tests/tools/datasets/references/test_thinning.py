from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.datasets import read_dataset
from panoloc_mcl.tools.datasets.references.thinning import thinned

HALL = Path(__file__).parents[4] / "shared" / "data" / "hall"


@pytest.fixture(scope="module")
def hall():
    if not HALL.is_dir():
        pytest.skip("needs the data set hall beside the project")
    return HALL


def test_a_checkerboard_is_one(small_room):
    left = thinned(small_room.references, "checkerboard")
    cells = np.rint(left.poses[:, :2]).astype(int)
    assert len(left) == len(left.files) == 6
    assert len(set(cells.sum(axis=1) % 2)) == 1
    assert all(small_room.references.files[index] in left.files for index in (0, 2, 5, 7, 8, 10))


@pytest.mark.parametrize(
    ("part", "count"), [("every-2m", 4), ("fourth", 4), ("every-0.5m", 12), ("every-2.5m", 2), ("all", 12)]
)
def test_references_at_a_distance(small_room, part, count):
    left = thinned(small_room.references, part).poses[:, :2]
    assert len(left) == count
    apart = np.hypot(*(left[:, None] - left[None]).T) + 10.0 * np.eye(count)
    if part.startswith("every"):
        assert apart.min() >= float(part[6:-1]) - 0.05


def test_scattered_references_thin_out_to_the_diagonal(small_room):
    references = small_room.references
    poses = references.poses + np.random.default_rng(3).normal(0.0, 0.2, references.poses.shape)
    left = thinned(replace(references, poses=poses), "checkerboard")
    assert 2 <= len(left) < 12


def test_the_hall_in_a_checkerboard_and_two_metres_apart(hall):
    references = read_dataset(hall).references
    assert len(thinned(references, "checkerboard")) == 21
    assert len(thinned(references, "every-2m")) == len(thinned(references, "fourth")) == 12


@pytest.mark.parametrize("part", ["half", "every-m", "every-99m"])
def test_parts_that_there_are_not(small_room, part):
    with pytest.raises(ConfigError, match=f"references: {part}"):
        thinned(small_room.references, part)

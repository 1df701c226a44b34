"""Robots that are carried away, by the strict definition."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from panoloc_mcl.laboratory.studies.filtering.kidnaps import Turned, kidnapped
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import angle_difference, between

COLUMNS, STRETCH = 90, 3


@pytest.fixture
def carried(small_room):
    drive = small_room.select("all")[0]
    return drive, kidnapped([drive], STRETCH, COLUMNS, np.random.default_rng(1))


def test_images_stand_where_they_were_taken_turned_by_their_columns(carried) -> None:
    drive, robot = carried
    truth = robot.drive.groundtruth.at(robot.drive.times)
    for file, turn, pose in zip(robot.drive.files, robot.turns, truth, strict=True):
        taken = drive.groundtruth.at(drive.times[drive.files.index(file)])
        np.testing.assert_allclose(pose[:2], taken[:2], atol=1e-9)
        assert abs(angle_difference(pose[2], taken[2] - 2.0 * np.pi * turn / COLUMNS)) < 1e-9
    assert len(set(robot.turns.tolist())) > 1


def test_odometry_is_silent_where_the_robot_is_carried_and_leads_along_otherwise(carried) -> None:
    _, robot = carried
    driven, truth = robot.drive.odometry.at(robot.drive.times), robot.drive.groundtruth.at(robot.drive.times)
    said, did = between(driven[:-1], driven[1:]), between(truth[:-1], truth[1:])
    joints = robot.carried[1:]
    np.testing.assert_allclose(said[joints], 0.0, atol=1e-9)
    # Odometry of the small room errs by some per cent.
    np.testing.assert_allclose(said[~joints], did[~joints], atol=0.1)
    assert robot.carried.sum() == len(robot.turns) // STRETCH - 1
    assert (np.diff(robot.drive.times) > 0.0).all()


def test_panoramas_are_turned_in_the_order_of_the_images() -> None:
    seen: list[Panorama] = []
    watching: Any = SimpleNamespace(observe=lambda panorama, headings: seen.append(panorama), name="votes")
    model = Turned(watching, [1, 0])
    picture = np.arange(12, dtype=np.float32).reshape(2, 6)
    for _ in range(2):
        model.observe(Panorama(picture, picture > 0))
    # What was seen a column to the right is now ahead.
    np.testing.assert_array_equal(seen[0].pixels[:, 0], picture[:, 1])
    np.testing.assert_array_equal(seen[0].valid, seen[0].pixels > 0)
    np.testing.assert_array_equal(seen[1].pixels, picture)
    assert model.name == "votes"


def test_drives_that_are_too_short_or_without_odometry_are_refused(small_room) -> None:
    drive = small_room.select("all")[0]
    with pytest.raises(DatasetError, match="kidnaps need drives of at least 1000 images"):
        kidnapped([drive], 1000, COLUMNS, np.random.default_rng(0))

"""The turn that creeps into odometry, in the small room."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.geometry import angle_difference, between
from panoloc_mcl.robot.map.drives import Drive
from panoloc_mcl.robot.map.drives.choice import chosen_keyframes
from panoloc_mcl.robot.map.drives.drift import drift_of, straightened, without
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.runs.map_drives import drives_of


@pytest.fixture
def drive(small_room: Dataset) -> Drive:
    """With odometry that is true."""
    (found,), _ = drives_of(small_room, ["*"])
    (recorded,) = small_room.sequences.values()
    return replace(found, odometry=recorded.groundtruth.at(found.times))


def test_a_turn_that_is_put_in_and_taken_out_leaves_nothing(drive: Drive) -> None:
    there = without(drive, np.radians(1.5))
    steps, bent = (between(one.odometry[:-1], one.odometry[1:]) for one in (drive, there))
    np.testing.assert_allclose(bent[:, :2], steps[:, :2], atol=1e-12)
    np.testing.assert_allclose(
        angle_difference(steps[:, 2], bent[:, 2]), np.radians(1.5) * np.hypot(*steps[:, :2].T), atol=1e-12
    )
    np.testing.assert_allclose(without(there, np.radians(-1.5)).odometry[:, :2], drive.odometry[:, :2], atol=1e-9)


@pytest.mark.slow
def test_the_turn_is_seen_in_the_images(tmp_path: Path) -> None:
    grid = tuple((float(x), float(y)) for y in range(2) for x in range(2))
    path = build_room(
        tmp_path / "data", frames=30, geometry=PanoramaGeometry(240, 96, -50.0, 25.0), grid=grid, lights=("noon",)
    )
    dataset = read_dataset(path)
    (found,), _ = drives_of(dataset, ["*"])
    (recorded,) = dataset.sequences.values()
    true = replace(found, odometry=recorded.groundtruth.at(found.times))
    keyframes = true.of(chosen_keyframes(true, 0.25))
    for degrees in (-1.5, 1.5):
        found_degrees = np.degrees(drift_of(without(keyframes, np.radians(-degrees)), VotesSettings()))
        assert found_degrees == pytest.approx(degrees, abs=0.6)
    assert abs(np.degrees(drift_of(keyframes, VotesSettings()))) < 0.6


def test_what_few_keyframes_say_is_not_taken(drive: Drive) -> None:
    notes: list[str] = []
    short = drive.of(np.arange(4))
    assert straightened(short, VotesSettings(), notes) is short
    assert notes == []

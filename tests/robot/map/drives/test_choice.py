"""Which images of a drive become keyframes, though odometry stands still, and though some show nothing."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from panoloc_mcl.robot.map.drives import Drive
from panoloc_mcl.robot.map.drives.choice import chosen_keyframes, keyframes_of, that_show_something
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.runs.map_drives import drives_of


@pytest.fixture
def drive(small_room: Dataset) -> Drive:
    (found,), _ = drives_of(small_room, ["*"])
    return found


def test_turning_on_the_spot_makes_no_keyframes() -> None:
    odometry = np.zeros((20, 3))
    odometry[:10, 2] = np.linspace(0.0, 3.0, 10)
    odometry[10:, 0] = 0.1 * np.arange(1, 11)
    turning = Drive("a", tuple(range(20)), np.arange(20.0), odometry, None, (1, 1))  # type: ignore[arg-type]
    np.testing.assert_array_equal(chosen_keyframes(turning, 0.25), [0, 12, 15, 18])


def test_where_odometry_stands_still_images_say_that_it_goes_on(drive: Drive) -> None:
    stalled = drive.odometry.copy()
    # Nothing is counted from the fifth image to the eighth; then it goes on from there.
    stalled[7:] -= stalled[7] - stalled[3]
    stalled[4:7] = stalled[3]
    broken = replace(drive, odometry=stalled)
    np.testing.assert_array_equal(broken.stands(), [4, 5, 6, 7])
    notes: list[str] = []
    found = keyframes_of(broken, VotesSettings(), 0.05, notes)
    (line,) = notes
    assert "odometry stands still while images change" in line
    new = [index for index in (4, 5, 6, 7) if drive.files[index] in found.files]
    assert len(new) >= 2
    assert f"first at {drive.times[new[0]]:.3f} s; {len(new)} more images" in line
    # Nothing is known of these steps, and of no others.
    edges = found.edges(0)
    doubted = [found.files.index(drive.files[index]) - 1 for index in new]
    assert (edges.covariances[doubted, 0, 0] >= 1.0).all()
    assert (np.delete(edges.covariances[:, 0, 0], doubted) < 0.1).all()


def test_a_robot_that_stands_is_no_stall(drive: Drive) -> None:
    again = np.array([0, 1, 2, 3, 3, 3, 3, *range(4, len(drive.files))])
    standing = replace(
        drive, files=tuple(drive.files[i] for i in again), odometry=drive.odometry[again], times=np.arange(float(len(again)))
    )
    notes: list[str] = []
    found = keyframes_of(standing, VotesSettings(), 0.05, notes)
    assert notes == []
    assert found.doubted == frozenset()
    assert len(found.files) == len(set(found.files))


def test_images_that_show_nothing_are_left_out_and_counted(drive: Drive, tmp_path: Path) -> None:
    dark = tmp_path / "dark.png"
    height, width = cv2.imread(str(drive.files[0]), cv2.IMREAD_GRAYSCALE).shape
    cv2.imwrite(str(dark), np.zeros((height, width), np.uint8))
    files = tuple(dark if index in (2, 5) else file for index, file in enumerate(drive.files))
    notes: list[str] = []
    seen = that_show_something(replace(drive, files=files), notes)
    assert dark not in seen.files
    assert len(seen.files) == len(drive.files) - 2
    (line,) = notes
    assert f"2 of {len(drive.files)} keyframes show nothing" in line

"""States, poses and maps that come between an event and the image that shows it; answers that their owner changes."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.errors import MeasurementError
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.floors import AnyLocalizer, FloorLocalizer, Transition
from panoloc_mcl.robot.interface.frozen_camera import FrozenCamera
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import GateSettings, LocalizerSettings
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_image

# The image before which something happens, and by how much clocks go back.
AT, BACK_S = 6, 20.0


def drive_on(localizer: AnyLocalizer, drive: Drive, first: int, last: int, back: float = 0.0) -> list:
    """Answers to images from one on, before another."""
    answers = []
    for number in range(first, last):
        begin = -np.inf if number == 0 else drive.times[number - 1]
        give_odometry(localizer, drive, begin, drive.times[number], back)
        answers.append(localizer.add_image(drive.times[number] - back, read_image(drive.files[number])))
    return answers


def give_odometry(localizer: AnyLocalizer, drive: Drive, begin: float, end: float, back: float = 0.0) -> None:
    for stamp, pose in zip(drive.odometry.times, drive.odometry.poses, strict=True):
        if begin < stamp <= end:
            localizer.add_odometry(stamp - back, pose)


def on_the_edge(panorama_map: PanoramaMap, drive: Drive) -> Localizer:
    """Driven up to an image; odometry's clock was set back since, and no image has come."""
    localizer = Localizer(panorama_map, seed=1)
    drive_on(localizer, drive, 0, AT)
    give_odometry(localizer, drive, drive.times[AT - 1], drive.times[AT], BACK_S)
    assert localizer._clock.owed_s > 0.0
    return localizer


def test_a_state_that_was_saved_before_an_image_showed_that_the_clock_went_back(
    panorama_map: PanoramaMap, drive: Drive, tmp_path: Path
) -> None:
    straight = on_the_edge(panorama_map, drive)
    straight.save_state(tmp_path / "state.npz")
    restored = Localizer(panorama_map, seed=2)
    restored.load_state(tmp_path / "state.npz")
    assert restored.pose_at().timestamp == straight.pose_at().timestamp
    answers = []
    for localizer in (straight, restored):
        first = localizer.add_image(drive.times[AT] - BACK_S, read_image(drive.files[AT]))
        answers.append([first, *drive_on(localizer, drive, AT + 1, AT + 3, BACK_S)])
    for one, other in zip(*answers, strict=True):
        assert other.timestamp == one.timestamp < drive.times[AT]
        assert np.array_equal(other.pose, one.pose)
        assert other.status is one.status


def test_a_pose_that_is_given_then_counts_for_its_own_time(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = on_the_edge(panorama_map, drive)
    when, pose = localizer.pose_at().timestamp, drive.groundtruth.at(drive.times[AT])
    localizer.set_pose(pose, np.diag([0.01, 0.01, 0.001]), when)
    assert localizer.pose_at(when).pose == pytest.approx(pose, abs=0.1)
    assert localizer.pose_at(when).covariance[0, 0] < 0.02


@pytest.mark.parametrize("forget", [Localizer.relocalize, lambda localizer: localizer.load_map(localizer.panorama_map)])
def test_a_pose_that_is_forgotten_then_is_found_again(
    forget: Callable[[Localizer], None], panorama_map: PanoramaMap, drive: Drive
) -> None:
    localizer = on_the_edge(panorama_map, drive)
    forget(localizer)
    answer = localizer.add_image(drive.times[AT] - BACK_S, read_image(drive.files[AT]))
    assert answer.timestamp == pytest.approx(drive.times[AT] - BACK_S)
    assert np.hypot(*(answer.pose - drive.groundtruth.at(drive.times[AT]))[:2]) < 0.1


def test_whoever_changes_an_answer_changes_nothing_else(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map, seed=1)
    answer = drive_on(localizer, drive, 0, AT)[-1]
    before = localizer.pose_at(answer.timestamp)
    answer.pose[:] = [100.0, 0.0, 180.0]
    answer.covariance[:] = 0.0
    answer.clusters[0].pose[:] = np.nan
    after = localizer.pose_at(answer.timestamp)
    assert np.array_equal(after.pose, before.pose)
    assert np.array_equal(after.covariance, before.covariance)
    again = localizer.add_image(math.nan, read_image(drive.files[AT]))
    assert np.array_equal(again.pose, before.pose)


def test_a_clock_that_jumps_while_the_gate_is_shut_is_told_and_followed(panorama_map: PanoramaMap, drive: Drive) -> None:
    config = LocalizerConfig(localizer=LocalizerSettings(gate=GateSettings(distance_m=0.1, angle_deg=5.0)))
    localizer = Localizer(panorama_map, config, seed=1)
    drive_on(localizer, drive, 0, AT)
    stands, image = drive.odometry.at(drive.times[AT - 1]), read_image(drive.files[AT - 1])
    told: list[Reason] = []
    for number in range(40):
        stamp = drive.times[AT - 1] - 600.0 + 0.1 * number
        localizer.add_odometry(stamp, stands)
        if number % 10 == 5:
            answer = localizer.add_image(stamp, image ^ np.uint8(number // 10 % 2))
            told += [] if answer is None else answer.reasons
    assert Reason.CLOCK_JUMPED in told
    assert localizer.pose_at().timestamp == pytest.approx(stamp)
    assert localizer.pose_at(stamp).covariance[0, 0] < 1.0


def test_a_pose_that_was_given_before_all_else_is_kept_in_the_next_map(panorama_map: PanoramaMap) -> None:
    localizer = Localizer(panorama_map, seed=1)
    localizer.set_pose([1.0, 1.0, 0.5], np.diag([0.01, 0.01, 0.01]))
    localizer.load_map(panorama_map, keep_pose=True)
    assert localizer.has_fix
    poses, weights = localizer.particles
    assert weights @ poses[:, :2] == pytest.approx([1.0, 1.0], abs=0.05)
    assert np.ptp(poses[:, 0]) < 1.0


def test_a_frozen_camera_is_known_after_a_restart(panorama_map: PanoramaMap, drive: Drive, tmp_path: Path) -> None:
    localizer = Localizer(panorama_map, seed=1)
    drive_on(localizer, drive, 0, AT)
    localizer.save_state(tmp_path / "state.npz")
    localizer = Localizer(panorama_map, seed=2)
    localizer.load_state(tmp_path / "state.npz")
    pose = drive.odometry.at(drive.times[AT - 1])
    localizer.add_odometry(drive.times[AT - 1] + 1.0, pose + np.array([0.5, 0.0, 0.0]))
    answer = localizer.add_image(drive.times[AT - 1] + 1.0, read_image(drive.files[AT - 1]))
    assert Reason.IMAGE_FROZEN in answer.reasons


@pytest.mark.parametrize("values", [[], [1.0, 2.0], [1.0, 2.0, 3.0, 4.0, 5.0]])
def test_damage_to_what_is_remembered_of_the_last_image_is_noticed(values: list[float]) -> None:
    with pytest.raises(ValueError, match="last image"):
        FrozenCamera.of_snapshot(values)


def test_odometry_says_whether_it_was_taken_and_no_pose_is_told_for_no_time(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map, seed=1)
    drive_on(localizer, drive, 0, 2)
    pose, time = drive.odometry.at(drive.times[1]), float(drive.times[1])
    assert localizer.add_odometry(time + 0.05, pose)
    assert not localizer.add_odometry(math.nan, pose)
    assert not localizer.add_odometry(time + 5000.0, pose)
    with pytest.raises(MeasurementError, match="not finite"):
        localizer.pose_at(math.nan)
    with pytest.raises(MeasurementError, match="velocity"):
        localizer.add_odometry(time + 0.1, pose, velocity=[1.0, 2.0])


def test_on_several_floors_both_poses_are_equally_sure_and_a_given_pose_is_at_no_lift(
    panorama_map: PanoramaMap, drive: Drive
) -> None:
    floors = FloorLocalizer({"a": panorama_map, "b": panorama_map})
    drive_on(floors, drive, 0, 3)
    assert floors.pose_at().status is Status.AMBIGUOUS
    assert floors.odometry_to_map().status is Status.AMBIGUOUS
    lift = tuple(floors.pose_at().pose[:2].tolist())
    floors = FloorLocalizer({"a": panorama_map, "b": panorama_map}, None, [Transition(("a", "b"), (lift, lift))])
    drive_on(floors, drive, 0, 3)
    floors.set_pose("a", drive.groundtruth.at(drive.times[-1]))
    assert not floors._ways()

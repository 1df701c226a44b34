import threading
import time
from typing import Any

import numpy as np
import pytest

from panoloc_mcl.robot.camera import Mount
from panoloc_mcl.robot.errors import ImageError, MapError, MeasurementError
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.geometry import angle_difference, compose
from panoloc_mcl.robot.interface.keeper import StateKeeper
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.streams import Image, Odometry, answers, recorded


def off(pose: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    return float(np.hypot(*(pose[:2] - true[:2]))), abs(float(angle_difference(pose[2], true[2])))


def test_between_images_the_pose_follows_odometry(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map)
    assert localizer.pose_at(0.0) is None
    assert localizer.odometry_to_map() is None
    last = None
    for message in recorded(drive):
        estimate = localizer.add(message)
        if estimate is not None:
            last = estimate
            now = localizer.pose_at(estimate.timestamp)
            assert np.array_equal(now.pose, estimate.pose)
            assert np.array_equal(now.covariance, estimate.covariance)
    halfway = 0.5 * (drive.times[-2] + drive.times[-1])
    back = localizer.pose_at(halfway)
    moved = off(back.pose, last.pose)[0] - off(drive.groundtruth.at(halfway), drive.groundtruth.at(drive.times[-1]))[0]
    assert abs(moved) < 0.1
    assert back.answered == last.timestamp
    assert np.trace(back.covariance) >= np.trace(last.covariance)
    frame = localizer.odometry_to_map()
    driven = drive.odometry.at(frame.timestamp)
    assert compose(frame.pose, driven) == pytest.approx(localizer.pose_at(frame.timestamp).pose, abs=1e-9)


@pytest.mark.slow  # a time is only worth something on a machine that is not shared
def test_a_pose_takes_less_than_the_time_between_two_measurements(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map)
    list(answers(localizer, recorded(drive)))
    newest = float(drive.odometry.times[-1])
    spent = []
    for _ in range(300):
        begin = time.perf_counter()
        localizer.pose_at(newest)
        spent.append(time.perf_counter() - begin)
    assert np.median(spent) < 150e-6


def test_a_given_pose_is_believed_until_images_say_otherwise(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map)
    assert not localizer.has_fix
    messages = list(recorded(drive))
    for message in messages[: len(messages) // 2]:
        localizer.add(message)
    wrong = np.array([0.1, 0.2, -1.0])
    localizer.set_pose(wrong, np.diag([1e-4, 1e-4, 1e-4]))
    given = localizer.pose_at()
    assert off(given.pose, wrong)[0] < 0.05
    assert given.status is Status.CONVERGED
    assert localizer.has_fix
    localizer.relocalize()
    assert localizer.pose_at() is None
    assert not localizer.has_fix
    late = [estimate for _, estimate in answers(localizer, messages[len(messages) // 2 :])]
    assert off(late[-1].pose, drive.groundtruth.at(late[-1].timestamp))[0] < 0.5
    assert localizer.has_fix


@pytest.mark.parametrize(
    ("pose", "covariance"),
    [
        ((0.0, 0.0), None),
        ((0.0, np.nan, 0.0), None),
        ((0.0, 0.0, 0.0), np.diag([1.0, -1.0, 1.0])),
        ((0.0, 0.0, 0.0), np.ones((2, 2))),
        ((0.0, 0.0, 0.0), [[1.0, 5.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ],
)
def test_an_impossible_pose_changes_nothing(panorama_map: PanoramaMap, pose: Any, covariance: Any) -> None:
    localizer = Localizer(panorama_map)
    before = localizer.particles[0].copy()
    with pytest.raises(MeasurementError):
        localizer.set_pose(pose, covariance)
    assert np.array_equal(before, localizer.particles[0])


def first_image(drive: Drive) -> np.ndarray:
    image = next(message for message in recorded(drive) if isinstance(message, Image)).pixels()
    assert isinstance(image, np.ndarray)
    return image


def test_one_image_is_located_by_itself(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map)
    image = first_image(drive)
    before = localizer.particles[0].copy()
    location = localizer.locate(image)
    assert off(location.pose, drive.groundtruth.poses[0])[0] < 0.5
    assert location.map_revision == localizer.map_revision
    assert np.linalg.eigvalsh(location.covariance).min() > 0.0
    assert np.array_equal(before, localizer.particles[0])
    assert localizer.counts["images"] == 0
    nothing = localizer.locate(np.zeros_like(image))
    assert nothing.problem
    with pytest.raises(ImageError):
        localizer.locate(image[:10])


@pytest.mark.slow
def test_another_map_takes_over_only_if_it_fits(panorama_map: PanoramaMap, drive: Drive, room) -> None:
    from panoloc_mcl.tools.datasets import read_dataset

    localizer = Localizer(panorama_map, camera=drive.camera, image_size=drive.image_size)
    messages = list(recorded(drive))
    list(answers(localizer, messages))
    pose, revision = localizer.pose_at().pose, localizer.map_revision
    from dataclasses import replace

    too_high = replace(panorama_map, references=replace(panorama_map.references, camera_height_m=9.0))
    with pytest.raises(MapError):
        localizer.load_map(too_high)
    assert np.array_equal(localizer.pose_at().pose, pose)
    assert localizer.map_revision == revision
    other = PanoramaMap.build(read_dataset(room))
    with pytest.warns(UserWarning, match="made by an earlier version"):
        Localizer(panorama_map, LocalizerConfig()).load_map(replace(other, arrays={}))
    localizer.load_map(panorama_map, keep_pose=True)
    assert np.array_equal(localizer.pose_at().pose, pose)
    assert localizer.has_fix
    localizer.load_map(panorama_map)
    assert localizer.pose_at() is None


def test_a_stopped_program_goes_on_where_it_was(panorama_map: PanoramaMap, drive: Drive, tmp_path) -> None:
    path = tmp_path / "state.npz"
    messages = list(recorded(drive))
    cut = [index for index, message in enumerate(messages) if isinstance(message, Image)][8] + 1
    first = Localizer(panorama_map)
    with StateKeeper(first, path, every_s=0.02) as keeper:
        assert not keeper.resumed
        list(answers(first, messages[:cut]))
        deadline = time.monotonic() + 5.0
        while not path.exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert path.exists()
    second = Localizer(panorama_map, seed=99)
    keeper = StateKeeper(second, path)
    assert keeper.resumed
    # At once, without an image.
    assert np.array_equal(second.pose_at(first.pose_at().timestamp).pose, first.pose_at().pose)
    assert second.counts == first.counts
    image, estimate = next(iter(answers(second, messages[cut:])))
    assert estimate.status is Status.CONVERGED
    assert off(estimate.pose, drive.groundtruth.at(image.timestamp))[0] < 0.5
    # The clock has begun anew, as when a recording is played again.
    third = Localizer(panorama_map)
    StateKeeper(third, path)
    image, estimate = next(iter(answers(third, messages)))
    assert "jumped" in estimate.message
    assert off(estimate.pose, drive.groundtruth.at(image.timestamp))[0] < 0.5


def test_a_state_that_cannot_be_used_is_told_and_left(panorama_map: PanoramaMap, tmp_path) -> None:
    (tmp_path / "state.npz").write_bytes(b"nothing of the kind")
    keeper = StateKeeper(Localizer(panorama_map), tmp_path / "state.npz")
    assert not keeper.resumed
    assert "state.npz" in keeper.problem
    (tmp_path / "file").write_text("")
    unwritable = StateKeeper(Localizer(panorama_map), tmp_path / "file" / "state.npz")
    unwritable.save()
    assert "cannot be written" in unwritable.problem


def test_images_and_odometry_may_come_from_two_threads(panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map, LocalizerConfig(localizer=LocalizerSettings()))
    messages = list(recorded(drive))
    failures: list[BaseException] = []
    done = threading.Event()

    def guarded(work) -> None:
        try:
            work()
        except BaseException as error:
            failures.append(error)

    def odometry() -> None:
        for message in messages:
            if not isinstance(message, Image):
                localizer.add(message)
                time.sleep(0.001)
        done.set()

    def ask() -> None:
        while not done.is_set():
            localizer.pose_at()
            localizer.odometry_to_map()
            _ = localizer.counts

    threads = [threading.Thread(target=guarded, args=(work,)) for work in (odometry, ask)]
    for thread in threads:
        thread.start()
    estimates = []
    for message in messages:
        if isinstance(message, Image):
            estimates.append(localizer.add(message))
    for thread in threads:
        thread.join(30.0)
    assert not failures
    assert all(np.isfinite(estimate.pose).all() for estimate in estimates)
    assert localizer.counts["images"] == len(drive)


def test_with_a_camera_off_the_centre_all_poses_are_the_bases(panorama_map: PanoramaMap, drive: Drive) -> None:
    mount = Mount(x_m=0.3, y_m=-0.2)
    localizer = Localizer(panorama_map, camera=drive.camera.model_copy(update={"mount": mount}), image_size=drive.image_size)
    # The robot whose camera drives as the recorded one did.
    for message in recorded(drive):
        if isinstance(message, Odometry):
            localizer.add_odometry(message.timestamp, mount.base_poses(message.pose))
        elif isinstance(message, Image):
            estimate = localizer.add_image(message.timestamp, message.pixels())
    true = mount.base_poses(drive.groundtruth.at(estimate.timestamp))
    assert off(estimate.pose, true)[0] < 0.5
    now = localizer.pose_at(estimate.timestamp)
    assert now.pose == pytest.approx(estimate.pose)
    assert now.covariance == pytest.approx(estimate.covariance)
    frame = localizer.odometry_to_map(estimate.timestamp)
    driven = localizer.driven(estimate.timestamp)
    assert driven is not None
    assert compose(frame.pose, driven) == pytest.approx(estimate.pose)
    image = first_image(drive)
    assert off(localizer.locate(image).pose, mount.base_poses(drive.groundtruth.poses[0]))[0] < 0.5
    localizer.set_pose((1.0, 2.0, 0.5), np.diag([1e-6, 1e-6, 1e-6]))
    assert localizer.pose_at().pose == pytest.approx([1.0, 2.0, 0.5], abs=0.01)

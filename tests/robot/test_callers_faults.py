"""What callers hand over that is none: no crash, no error outside the tree, and never sure of what nothing has confirmed."""

import copy
import math
import multiprocessing
import pickle
import threading
from datetime import UTC, datetime
from decimal import Decimal
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from panoloc_mcl.robot.errors import ConfigError, ImageError, MeasurementError, PanolocError
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.filters.particles.blocks import BLOCK, Blocks
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.robot.single_blas import one_blas_thread
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_image

MODES = ["monte_carlo", "kalman_orientation"]


@pytest.fixture(scope="module")
def drive(small_room: Dataset):
    sequence = small_room.sequences["noon_00"]
    return SimpleNamespace(
        times=sequence.times.tolist(),
        images=[read_image(file) for file in sequence.files],
        odometry=list(zip(sequence.odometry.times.tolist(), sequence.odometry.poses, strict=True)),
        start=tuple(sequence.groundtruth.poses[0]),
        truth=sequence.groundtruth.at(sequence.times).tolist(),
    )


def started(panorama_map: PanoramaMap, drive, mode: str = "monte_carlo", images: int = 4) -> Localizer:
    """After the first images of the drive, sure of its pose."""
    config = RunConfig(localizer=LocalizerSettings(mode=mode, initial="known_pose"))
    localizer = Localizer(panorama_map, config, start_pose=drive.start)
    for time, pose in drive.odometry:
        if time <= drive.times[images - 1] + 0.2:
            localizer.add_odometry(time, pose)
    for time, image in zip(drive.times[:images], drive.images, strict=False):
        estimate = localizer.add_image(time, image)
    assert estimate.status is Status.CONVERGED
    return localizer


@pytest.mark.parametrize(
    "start", [(0.0, 0.0, math.nan), (math.inf, 0.0, 0.0), (0.0, 1e308, 0.0), (1.0, 2.0), "abc", (1.0, 2.0, None)]
)
@pytest.mark.parametrize("mode", MODES)
def test_a_start_that_cannot_be_is_one_line(start, mode: str, panorama_map: PanoramaMap) -> None:
    config = RunConfig(localizer=LocalizerSettings(mode=mode, initial="known_pose"))
    with pytest.raises((ConfigError, MeasurementError), match="start_pose") as caught:
        Localizer(panorama_map, config, start_pose=start)
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize(
    "stamp",
    [
        Decimal("1000.5"),
        np.array(1000.5),
        np.array([1000.5]),
        np.float32(1000.5),
        datetime.fromtimestamp(1000.5, tz=UTC),
        np.datetime64(1000500, "ms"),
        SimpleNamespace(sec=1000, nanosec=500_000_000),
        SimpleNamespace(nanoseconds=1_000_500_000_000),
    ],
)
def test_stamps_that_tell_a_time_are_taken(stamp, panorama_map: PanoramaMap, drive) -> None:
    localizer = Localizer(panorama_map)
    localizer.add_odometry(stamp, (0.0, 0.0, 0.0))
    assert localizer.add_image(stamp, drive.images[0]).timestamp == 1000.5


@pytest.mark.parametrize("stamp", ["1000.5", None, True, [1.0, 2.0], np.array([1.0, 2.0]), 1j, b"1"])
def test_stamps_that_tell_none_are_known_errors(stamp, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive)
    for call in (lambda: localizer.add_image(stamp, drive.images[0]), lambda: localizer.add_odometry(stamp, (0.0, 0.0, 0.0))):
        with pytest.raises(PanolocError, match="time stamp") as caught:
            call()
        assert len(caught.value.faults) == 1
    # Nothing has happened to it.
    assert localizer.add_image(drive.times[4], drive.images[4]).message == ""


@pytest.mark.parametrize("pose", [(1.0, 2.0), range(6), range(7), "abc", None, [[1.0, 2.0, 3.0]], (1.0, 2.0, "x")])
def test_odometry_of_another_form_is_a_known_error(pose, panorama_map: PanoramaMap) -> None:
    with pytest.raises(PanolocError, match="odometry pose"):
        Localizer(panorama_map).add_odometry(1.0, pose)


@pytest.mark.parametrize("far", [1e17, 1e308, -1e12])
@pytest.mark.filterwarnings("error")
def test_absurd_first_odometry_is_left_out(far: float, panorama_map: PanoramaMap, drive) -> None:
    plain, disturbed = Localizer(panorama_map), Localizer(panorama_map)
    disturbed.add_odometry(drive.odometry[0][0] - 0.1, (far, 0.0, 0.0))
    for localizer in (plain, disturbed):
        for time, pose in drive.odometry[:12]:
            localizer.add_odometry(time, pose)
    one, other = (localizer.add_image(drive.times[0], drive.images[0]) for localizer in (plain, disturbed))
    assert np.array_equal(one.pose, other.pose)
    assert Reason.ODOMETRY_LEFT_OUT in other.reasons


@pytest.mark.parametrize(("factor", "unit"), [(1e9, "nanoseconds"), (1e6, "microseconds"), (1e3, "milliseconds")])
def test_stamps_in_another_unit_are_named_and_nothing_is_sure(factor, unit, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive)
    for number in range(6):
        stamp = (1.7e9 + number) * factor
        localizer.add_odometry(stamp, (0.0, 0.0, 0.0))
        estimate = localizer.add_image(stamp, drive.images[4])
        assert unit in estimate.message
        assert Reason.STAMP_UNIT in estimate.reasons
    assert estimate.status is Status.STALE
    assert Reason.NOTHING_COUNTED in estimate.reasons
    # Seconds again, and all is well.
    assert localizer.add_image(drive.times[4], drive.images[4]).status is Status.CONVERGED


def test_an_image_that_could_not_be_read_keeps_its_reason(panorama_map: PanoramaMap, drive) -> None:
    estimate = started(panorama_map, drive).add_image(
        drive.times[4], ImageError("a.png: is cut off after 9 bytes; copy it again")
    )
    assert "a.png: is cut off" in estimate.message
    assert estimate.reasons == (Reason.IMAGE_UNUSABLE,)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["black", "unreadable", "twice", "not finite", "ahead"])
def test_sure_only_as_long_as_images_count(kind: str, mode: str, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive, mode)
    statuses = []
    for time, pose in drive.odometry if kind in ("black", "unreadable") else ():
        if drive.times[3] + 0.2 < time < drive.times[4] + 0.6:
            localizer.add_odometry(time, pose)
    for number in range(8):
        time, image = drive.times[4] + 0.05 * number, drive.images[4]
        if kind == "black":
            image = np.zeros_like(image)
        elif kind == "unreadable":
            image = ImageError("a.png: no such file; add it")
        else:
            # Ahead and apart, so that no two of them agree.
            time = {"twice": drive.times[3], "not finite": math.nan, "ahead": drive.times[3] + 100.0 * 2**number}[kind]
        estimate = localizer.add_image(time, image)
        statuses.append(estimate.status)
    assert statuses[0] is Status.CONVERGED
    assert statuses[4:] == [Status.STALE] * 4
    assert Reason.NOTHING_COUNTED in estimate.reasons
    assert len(estimate.message.splitlines()) == 1
    after = localizer.add_image(drive.times[4] + 0.5, drive.images[4])
    assert after.status is not Status.STALE
    assert Reason.NOTHING_COUNTED not in after.reasons


class Doubting:
    """A model that knows little of this light: it gives what it sees hardly any confidence, but enough to be taken in."""

    def __init__(self, model) -> None:
        self._model = model

    def __getattr__(self, name: str):
        if name.startswith("__") or name == "observe_near":
            raise AttributeError(name)
        return getattr(self._model, name)

    def observe(self, panorama, headings=None):
        return self._model.observe(panorama, headings).judged(0.3, "")


@pytest.mark.parametrize("elsewhere", [True, False])
def test_doubtful_images_keep_a_pose_only_if_they_speak_for_it(elsewhere: bool, panorama_map: PanoramaMap, drive) -> None:
    """Doubtful images of where the robot is confirm it, but those of a robot that was carried off no more than three times."""
    localizer = started(panorama_map, drive)
    localizer._observation = cast(ObservationModel, Doubting(localizer._observation))
    for time, pose in drive.odometry:
        if time > drive.times[3] + 0.2:
            localizer.add_odometry(time, pose)
    statuses = []
    for number in range(4, len(drive.times)):
        ahead = np.hypot(*(np.array(drive.truth) - drive.truth[number])[:, :2].T)
        image = drive.images[int(np.argmax(ahead)) if elsewhere else number]
        statuses.append(localizer.add_image(drive.times[number], image).status)
    assert len(statuses) > 6
    assert (Status.CONVERGED in statuses[3:]) != elsewhere
    assert set(statuses) == {Status.CONVERGED} or elsewhere


@pytest.mark.parametrize("mode", MODES)
def test_a_pose_that_odometry_has_left_is_stale_at_once(mode: str, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive, mode)
    pose = drive.odometry[-1][1]
    for step in range(1, 20):
        localizer.add_odometry(drive.times[3] + 0.3 + 0.1 * step, pose + np.array([0.1 * step, 0.0, 0.0]))
    estimate = localizer.add_image(drive.times[3], drive.images[3])
    assert estimate.status is Status.STALE
    assert Reason.POSE_OUTDATED in estimate.reasons


@pytest.mark.parametrize("off_deg", [0.0, 60.0, 120.0, 180.0])
def test_the_baseline_is_not_sure_of_a_wrong_heading(off_deg: float, panorama_map: PanoramaMap, drive) -> None:
    settings = LocalizerSettings(mode="kalman_orientation", initial="known_heading", initial_heading_error_deg=off_deg)
    localizer = Localizer(panorama_map, RunConfig(localizer=settings), start_pose=drive.start)
    for time, pose in drive.odometry:
        localizer.add_odometry(time, pose)
    estimates = [localizer.add_image(time, image) for time, image in zip(drive.times, drive.images, strict=True)]
    sure = [estimate.status is Status.CONVERGED for estimate in estimates[3:]]
    assert sum(sure) == (len(sure) if off_deg == 0.0 else 0)


def test_a_saved_state_remembers_what_did_not_count(panorama_map: PanoramaMap, drive, tmp_path) -> None:
    localizer = started(panorama_map, drive)
    for _ in range(4):
        localizer.add_image(math.nan, drive.images[4])
    localizer.save_state(tmp_path / "state.npz")
    restored = Localizer(panorama_map, localizer.config, start_pose=drive.start)
    restored.load_state(tmp_path / "state.npz")
    for one in (localizer, restored):
        assert one.add_image(math.nan, drive.images[4]).status is Status.STALE


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda localizer: pickle.loads(pickle.dumps(localizer))])
def test_a_copy_goes_on_as_the_original(twin, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive)
    other = twin(localizer)
    answers = [one.add_image(drive.times[4], drive.images[4]) for one in (localizer, other)]
    assert np.array_equal(answers[0].pose, answers[1].pose)


def test_the_host_gets_its_blas_threads_back() -> None:
    def threads() -> list[int]:
        return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

    before = threads()
    inside, leave = [threading.Event(), threading.Event()], [threading.Event(), threading.Event()]

    def work(number: int) -> None:
        with one_blas_thread():
            inside[number].set()
            leave[number].wait(10)

    workers = [threading.Thread(target=work, args=(number,)) for number in (0, 1)]
    for number, worker in enumerate(workers):
        worker.start()
        inside[number].wait(10)
    # The first that came goes first; the other is still at work.
    for number, expected in enumerate(([1] * len(before), before)):
        leave[number].set()
        workers[number].join(10)
        assert threads() == expected


def _count(queue, blocks: Blocks) -> None:
    done = np.zeros(4 * BLOCK)

    def work(block: slice) -> None:
        done[block] = 1.0

    blocks.each(work, len(done))
    queue.put(float(done.sum()))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_threads_work_in_a_forked_child() -> None:
    blocks, context = Blocks(2), multiprocessing.get_context("fork")
    queue = context.Queue()
    _count(queue, blocks)
    child = context.Process(target=_count, args=(queue, blocks), daemon=True)
    child.start()
    assert [queue.get(timeout=20), queue.get(timeout=20)] == [4.0 * BLOCK] * 2
    child.join(20)

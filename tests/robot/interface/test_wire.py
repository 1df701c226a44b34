"""What happens on the wire: clocks, frames and messages that go wrong in the middle of a run. The pose is back within two images."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.laboratory.studies.streams.racing import race
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.streams import Image, Message, Odometry, recorded

CUT = 6  # the fault comes before this image


def play(localizer: Localizer, messages: Iterable[Message]) -> list[tuple[int, Estimate]]:
    """Answers with the number of the image."""
    found = []
    for message in messages:
        estimate = localizer.add(message)
        if estimate is not None:
            found.append((message.index, estimate))
    return found


def error(drive: Drive, index: int, estimate: Estimate) -> float:
    return float(np.hypot(*(estimate.pose[:2] - drive.groundtruth.at(drive.times[index])[:2])))


def changed(drive: Drive, change: Callable[[Message, bool], Message]) -> list[Message]:
    """Messages, each changed as if it came before or after the fault."""
    after, out = False, []
    for message in recorded(drive):
        after |= isinstance(message, Image) and message.index >= CUT
        out.append(change(message, after))
    return out


def reset(message: Message, after: bool) -> Message:
    """Odometry begins anew from zero."""
    if after and isinstance(message, Odometry):
        return replace(message, pose=compose([-3.0, 40.0, 2.0], message.pose))
    return message


def set_back(seconds: float) -> Callable[[Message, bool], Message]:
    def change(message: Message, after: bool) -> Message:
        return replace(message, timestamp=message.timestamp - seconds) if after else message

    return change


FAULTS = {
    "odometry reset": reset,
    "clock set back by an hour": set_back(3600.0),
    "clock set back by five seconds": set_back(5.0),
    "clock ahead by a day": set_back(-86400.0),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_pose_is_back_within_two_images(fault: str, panorama_map: PanoramaMap, drive: Drive) -> None:
    localizer = Localizer(panorama_map)
    answered = play(localizer, changed(drive, FAULTS[fault]))
    assert all(np.isfinite(estimate.pose).all() and np.isfinite(estimate.covariance).all() for _, estimate in answered)
    later = [(index, estimate) for index, estimate in answered if index >= CUT + 2]
    assert len(later) >= 3
    for index, estimate in later:
        assert error(drive, index, estimate) < 0.5
        assert estimate.status in (Status.CONVERGED, Status.LOST)
    assert later[-1][1].status is Status.CONVERGED
    # Something was said of it.
    assert any(estimate.message for index, estimate in answered if CUT <= index <= CUT + 2)


def test_thirty_percent_lost_others_doubled_and_out_of_order(panorama_map: PanoramaMap, drive: Drive) -> None:
    rng = np.random.default_rng(5)
    messages = [message for message in recorded(drive) if rng.random() > 0.3]
    messages = [message for message in messages for _ in range(1 + int(rng.random() < 0.2))]
    order = np.argsort(np.arange(len(messages)) + rng.uniform(0.0, 3.0, len(messages)), kind="stable")
    localizer = Localizer(panorama_map)
    answered = play(localizer, [messages[index] for index in order])
    assert answered[-1][1].status is Status.CONVERGED
    assert np.median([error(drive, index, estimate) for index, estimate in answered[2:]]) < 0.5
    counts = localizer.counts
    assert counts["images"] == sum(isinstance(message, Image) for message in messages)
    assert sum(count for name, count in counts.items() if "duplicated" in name) > 0


def test_images_of_another_size_are_left_out_and_said(panorama_map: PanoramaMap, drive: Drive) -> None:
    messages = [
        replace(message, source=np.zeros((7, 9), np.uint8))
        if isinstance(message, Image) and message.index in (4, 5)
        else message
        for message in recorded(drive)
    ]
    localizer = Localizer(panorama_map)
    answered = dict(play(localizer, messages))
    assert "9 x 7" in answered[4].message
    assert error(drive, 6, answered[6]) < 0.5
    assert localizer.counts["images skipped"] == 2


def test_thirty_percent_lost_and_the_pose_is_back_within_two_images(panorama_map: PanoramaMap, drive: Drive) -> None:
    """Whatever is lost: at every image from the third that comes on, the pose is right, or not said to be known."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        answered = play(Localizer(panorama_map), [message for message in recorded(drive) if rng.random() > 0.3])
        for index, estimate in answered[2:]:
            assert error(drive, index, estimate) < 0.5
            assert estimate.status is Status.CONVERGED


def test_a_map_that_does_not_load_leaves_the_old_one_at_work(panorama_map: PanoramaMap, drive: Drive, tmp_path) -> None:
    damaged = tmp_path / "new.panomap"
    panorama_map.save(damaged)
    damaged.write_bytes(damaged.read_bytes()[:-1000])
    expected = play(Localizer(panorama_map), recorded(drive))
    localizer, found = Localizer(panorama_map), []
    for message in recorded(drive):
        estimate = localizer.add(message)
        if estimate is not None:
            found.append(estimate.pose)
            if message.index == CUT:
                with pytest.raises(MapError) as caught:
                    localizer.load_map(PanoramaMap.load(damaged))
                assert len(caught.value.faults) == 1
                assert "new.panomap" in str(caught.value)
    assert np.array_equal(found, [estimate.pose for _, estimate in expected])


@pytest.mark.parametrize("seconds", [2.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_threads_race(seconds: float, panorama_map: PanoramaMap, drive: Drive) -> None:
    """Images, odometry, questions and orders from four threads at once; then one drive shows that nothing is broken."""
    found = race(Localizer(panorama_map), drive, seconds)
    assert found.failures.total() == 0
    assert all(calls > 3 for calls in found.calls.values())
    assert found.status is Status.CONVERGED
    assert found.error_m < 0.5
    assert 0 < found.back_after <= 2


def test_a_race_that_breaks_something_is_told(panorama_map: PanoramaMap, drive: Drive, monkeypatch) -> None:
    localizer = Localizer(panorama_map)
    monkeypatch.setattr(localizer, "odometry_to_map", lambda: 1 / 0)
    found = race(localizer, drive, 0.3)
    assert found.failures["questions: ZeroDivisionError: division by zero"] > 0

"""Clocks that go wrong in mid-drive: noticed, told, and nobody is sure of a wrong pose for long.

What happens to single stamps is in `motion`; here a whole localizer drives.
"""

from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.tools.datasets import Dataset, read_image

TIME_BEGAN_ANEW = {Reason.CLOCK_SET_BACK, Reason.CLOCK_JUMPED, Reason.STREAM_LOOPED}
# The image that something happens at.
AT = 6


@pytest.fixture(scope="module")
def drive(small_room: Dataset) -> SimpleNamespace:
    sequence = small_room.sequences["noon_00"]
    return SimpleNamespace(
        times=sequence.times,
        images=[read_image(file) for file in sequence.files],
        odometry=sequence.odometry,
        truth=sequence.groundtruth.at(sequence.times),
        start=tuple(sequence.groundtruth.poses[0]),
    )


def driven(
    localizer: Localizer,
    drive: SimpleNamespace,
    images: Callable[[float], float],
    odometry: Callable[[float], float] | None,
    begin: float = 0.0,
) -> Iterator[Estimate]:
    """Answers along the drive, by clocks that show other times; without odometry where there is no clock of it."""
    last = -np.inf
    for time, image in zip(drive.times, drive.images, strict=True):
        if odometry is not None:
            for stamp, pose in zip(drive.odometry.times, drive.odometry.poses, strict=True):
                if last < stamp <= time:
                    localizer.add_odometry(begin + odometry(stamp), pose)
        last = time
        estimate = localizer.add_image(begin + images(time), image)
        assert estimate is not None
        yield estimate


def started(panorama_map: PanoramaMap, drive: SimpleNamespace) -> Localizer:
    config = LocalizerConfig(localizer=LocalizerSettings(initial="known_pose"))
    return Localizer(panorama_map, config, start_pose=drive.start)


def longest_lie(estimates: list[Estimate], truth: np.ndarray) -> int:
    """The most images in a row that it was sure and more than a metre off at."""
    longest = in_row = 0
    for estimate, true in zip(estimates, truth, strict=True):
        wrong = estimate.status is Status.CONVERGED and np.hypot(*(estimate.pose[:2] - true[:2])) > 1.0
        in_row = in_row + 1 if wrong else 0
        longest = max(longest, in_row)
    return longest


@pytest.mark.slow
@pytest.mark.parametrize("odometry_follows", [True, False])
@pytest.mark.parametrize("back", [3.0, 7.0, 12.0, 25.0])
def test_a_clock_set_back_in_mid_drive(back: float, odometry_follows: bool, panorama_map: PanoramaMap, drive) -> None:
    def clock(time: float) -> float:
        return time - (back if time >= drive.times[AT] - 0.05 else 0.0)

    estimates = list(driven(started(panorama_map, drive), drive, clock, clock if odometry_follows else float, 100.0))
    told = [bool(TIME_BEGAN_ANEW & set(estimate.reasons)) for estimate in estimates]
    assert not any(told[:AT])
    assert longest_lie(estimates, drive.truth) <= 1
    assert any(told[AT : AT + 2])
    assert estimates[-1].status is Status.CONVERGED
    assert np.hypot(*(estimates[-1].pose[:2] - drive.truth[-1][:2])) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("with_odometry", [True, False])
def test_a_recording_that_loops(with_odometry: bool, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive)
    odometry = float if with_odometry else None
    estimates = [one for _ in range(3) for one in driven(localizer, drive, float, odometry, 100.0)]
    count = len(drive.times)
    told = [bool(TIME_BEGAN_ANEW & set(estimate.reasons)) for estimate in estimates]
    for begin in (count, 2 * count):
        # Without odometry they may be images that were sent again, until there are three.
        assert any(told[begin : begin + (2 if with_odometry else 3)])
    assert longest_lie(estimates, np.tile(drive.truth, (3, 1))) <= 2
    assert estimates[-1].status is Status.CONVERGED


@pytest.mark.slow
def test_stamps_that_went_through_single_precision(panorama_map: PanoramaMap, drive) -> None:
    """Since 1970 they know two minutes: all images of the drive have one or two stamps."""
    estimates = list(
        driven(started(panorama_map, drive), drive, lambda time: float(np.float32(1.7e9 + time)), lambda time: 1.7e9 + time)
    )
    assert any("single precision" in estimate.message for estimate in estimates)
    assert longest_lie(estimates, drive.truth) <= 3
    assert estimates[-1].status is not Status.CONVERGED


@pytest.mark.slow
@pytest.mark.parametrize("gap", [11.0, 30.0])
def test_images_far_apart_without_odometry_count(gap: float, panorama_map: PanoramaMap, drive) -> None:
    localizer = started(panorama_map, drive)
    estimates = list(driven(localizer, drive, lambda time: gap * time, None))
    assert localizer.images_skipped <= 1
    assert longest_lie(estimates, drive.truth) == 0
    errors = [np.hypot(*(one.pose[:2] - true[:2])) for one, true in zip(estimates, drive.truth, strict=True)]
    assert np.median(errors) < 0.1

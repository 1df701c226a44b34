import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoloc_mcl.robot.motion import ImageClock, OdometryBuffer
from panoloc_mcl.robot.settings.localizer import MotionSettings

SETTINGS = MotionSettings(buffer_s=3.0, clock_jump_s=10.0)


def a_clock(*, odometry_until: float = 0.0) -> ImageClock:
    """After images at 0, 1 and 2 s; odometry from 0 s on, if any."""
    odometry = OdometryBuffer(SETTINGS)
    for time in np.arange(0.0, odometry_until, 0.5):
        odometry.add(float(time), np.zeros(3))
    clock = ImageClock(SETTINGS, odometry)
    for time in (0.0, 1.0, 2.0):
        taken(clock, time)
    return clock


def taken(clock: ImageClock, timestamp: float) -> float | None:
    """What the localizer does with a stamp that can be used; how far the clock had jumped."""
    assert clock.problem(timestamp) == ""
    jump = clock.follow(timestamp)
    clock.fuse(timestamp)
    return jump


@given(st.lists(st.floats(0.01, 9.0), min_size=1, max_size=20))
def test_stamps_that_rise_are_all_taken(steps: list[float]) -> None:
    clock = a_clock()
    for time in 2.0 + np.cumsum(steps):
        assert taken(clock, float(time)) is None
        assert clock.now == time


def test_a_late_image_leaves_the_time_of_the_belief() -> None:
    clock = a_clock()
    assert clock.is_late(0.5)
    assert taken(clock, 0.5) is None
    assert clock.now == 2.0


@pytest.mark.parametrize("stamp", [0.0, 1.0, 2.0])
def test_no_stamp_comes_twice(stamp: float) -> None:
    assert "came twice" in a_clock().problem(stamp)


@pytest.mark.parametrize(("stamp", "words"), [(-1.5, "late"), (13.0, "ahead"), (np.nan, "finite"), (np.inf, "finite")])
def test_what_lies_far_from_all_others_is_left_out(stamp: float, words: str) -> None:
    clock = a_clock()
    assert words in clock.problem(stamp)
    # The next good one is taken as if nothing had been.
    assert taken(clock, 3.0) is None


@pytest.mark.parametrize("to", [-500.0, 5000.0])
def test_two_that_agree_make_a_jump(to: float) -> None:
    clock = a_clock()
    assert clock.problem(to)
    assert taken(clock, to + 1.0) == to - 2.0
    assert clock.now == to + 1.0
    assert taken(clock, to + 2.0) is None


def test_two_that_lie_far_apart_make_none() -> None:
    clock = a_clock()
    assert clock.problem(500.0)
    assert clock.problem(900.0)
    assert taken(clock, 3.0) is None


def test_time_goes_on_with_odometry_while_images_are_missing() -> None:
    assert taken(a_clock(odometry_until=40.0), 45.0) is None
    assert a_clock().problem(45.0)


def test_a_restored_clock_goes_on_as_the_saved_one() -> None:
    saved = a_clock()
    saved.problem(700.0)
    clock = ImageClock(SETTINGS, OdometryBuffer(SETTINGS))
    clock.restore(json.loads(json.dumps(saved.snapshot())))
    assert "came twice" in clock.problem(1.0)
    assert taken(clock, 701.0) == taken(saved, 701.0) == 698.0


@pytest.mark.parametrize("again", [3, 6])
@pytest.mark.parametrize("at_once", [True, False])
def test_images_that_are_sent_again_at_once_are_no_clock_that_was_set_back(again: int, at_once: bool) -> None:
    odometry = OdometryBuffer(MotionSettings())
    clock = ImageClock(MotionSettings(), odometry)
    for time in np.arange(0.0, 10.5, 0.5):
        odometry.add(float(time), np.array([0.2 * time, 0.0, 0.0]))
        taken(clock, float(time))
    told = ""
    for number in range(again):
        if not at_once:
            time = 10.5 + 0.5 * number
            odometry.add(time, np.array([0.2 * time, 0.0, 0.0]))
        # The very stamps of images that there were.
        stamp = 6.0 + 0.5 * number
        told = told or clock.set_back(stamp + clock.offset_s)
        if not clock.problem(stamp + clock.offset_s):
            taken(clock, stamp + clock.offset_s)
    assert bool(told) != at_once
    assert clock.offset_s == (0.0 if at_once else 4.5)
    assert clock.now == (10.0 if at_once else 6.0 + 0.5 * (again - 1) + 4.5)


@pytest.mark.parametrize("ahead", [0.0, 3.0, 6.0, 20.0])
def test_images_that_come_behind_a_pose_that_was_given_are_no_clock_that_was_set_back(ahead: float) -> None:
    """On a slow machine images come seconds behind odometry, at whose newest time somebody gives a pose."""
    odometry = OdometryBuffer(MotionSettings())
    clock = ImageClock(MotionSettings(), odometry)
    told = []
    for number in range(12):
        time = 0.8 * number
        while odometry.newest < time + ahead:
            after = 0.0 if not len(odometry) else odometry.newest + 0.2
            odometry.add(after, np.array([0.2 * after, 0.0, 0.0]))
        if number == 5:
            clock.start_at(odometry.newest)
        told.append(clock.set_back(time + clock.offset_s))
        if not clock.problem(time + clock.offset_s):
            clock.fuse(time + clock.offset_s)
    assert not any(told)
    assert clock.offset_s == 0.0

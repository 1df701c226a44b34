"""Clocks that are set back, and recordings that begin again, in odometry and in images."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.motion import ImageClock, OdometryBuffer
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.localizer import MotionSettings


def way(time):
    """A winding drive at half a metre a second."""
    return np.array([0.5 * time, 0.4 * np.sin(0.5 * time), 0.6 * np.sin(0.3 * time)])


def driven(until: float = 12.0, rate: float = 10.0, begin: float = 0.0) -> OdometryBuffer:
    buffer = OdometryBuffer(MotionSettings())
    for time in np.arange(begin, until, 1.0 / rate):
        buffer.add(float(time), way(time))
    return buffer


@pytest.mark.parametrize("back", [1.5, 3.0, 7.0, 11.0])
@pytest.mark.parametrize("rate", [5.0, 10.0, 50.0])
@pytest.mark.parametrize("since", [12.0, 4.0])
def test_a_clock_that_is_set_back_is_followed_at_once(back: float, rate: float, since: float) -> None:
    """Be it to a time that odometry is known of, or to before it began."""
    buffer = driven(12.0, rate, 12.0 - since)
    for step in range(1, 5):
        time = 12.0 - 1.0 / rate + step / rate
        buffer.add(time - back, way(time))
    assert buffer.set_back_s == pytest.approx(back, abs=1.5 / rate)
    assert list(buffer.events) == [f"its clock was set back by {buffer.set_back_s:.1f} s"]
    # The way across the change is known, by the new time.
    moved = buffer.motion(12.0 - back - 2.0, 12.0 - back + 3.0 / rate).increment
    true = np.hypot(*(way(12.0 + 3.0 / rate) - way(10.0))[:2])
    assert np.hypot(*moved[:2]) == pytest.approx(true, abs=0.6 / rate)


@given(st.permutations(range(40)), st.floats(0.05, 0.5))
@settings(max_examples=300, deadline=None)
def test_late_measurements_in_any_order_are_late(order, step) -> None:
    buffer = OdometryBuffer(MotionSettings(max_speed_m_s=None, max_turn_rate_deg_s=None))
    for index in order:
        buffer.add(step * index, way(step * index))
    assert buffer.set_back_s == 0.0
    assert buffer.restarts == 0


@pytest.mark.parametrize("late", [1, 3, 10, 30])
def test_a_batch_that_comes_late_is_late(late: int) -> None:
    buffer = OdometryBuffer(MotionSettings())
    times = np.arange(0.0, 12.0, 0.1)
    held = set(range(60, 60 + late))
    for index, time in enumerate(times):
        if index not in held:
            buffer.add(float(time), way(time))
    for index in sorted(held):
        buffer.add(float(times[index]), way(times[index]))
    assert not buffer.events
    assert not buffer.rejected
    assert len(buffer) == len(times)


def test_standing_still_tells_nothing_until_it_moves() -> None:
    buffer = driven(5.0)
    place = way(4.9)
    for time in np.arange(5.0, 15.0, 0.1):
        buffer.add(float(time), place)
    for step in range(40):
        buffer.add(15.0 - 4.0 + 0.1 * step, place + np.array([0.05 * max(0, step - 20), 0.0, 0.0]))
    assert buffer.set_back_s > 1.0
    assert buffer.motion(buffer.newest - 1.0, buffer.newest).distance == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize("length", [4.0, 12.0, 25.0])
def test_a_recording_that_begins_again_is_noticed(length: float) -> None:
    buffer = driven(length)
    for time in np.arange(0.0, 2.0, 0.1):
        buffer.add(float(time), way(time))
    assert buffer.restarts == 1
    assert list(buffer.events) == ["the recording began again"]
    assert buffer.newest == pytest.approx(1.9)
    # All that came since is known, and when it begins once more, it is noticed as soon.
    assert buffer.motion(0.2, 1.0).distance == pytest.approx(driven(2.0).motion(0.2, 1.0).distance)
    for time in np.arange(0.0, 0.7, 0.1):
        buffer.add(float(time), way(time))
    assert buffer.restarts == 2


def images(clock: ImageClock, stamps) -> list:
    """Findings about a stream of images."""
    found = []
    for stamp in stamps:
        clock.follow_odometry()
        found.append(clock.set_back(stamp + clock.offset_s))
        time = stamp + clock.offset_s
        found.append(clock.problem(time))
        if not found[-1]:
            clock.follow(time)
            clock.fuse(time)
    return [finding for finding in found if finding]


@pytest.mark.parametrize("back", [3.0, 10.0, 25.0])
def test_images_go_back_with_odometry(back: float) -> None:
    buffer = driven(30.0)
    clock = ImageClock(MotionSettings(), buffer)
    assert not images(clock, np.arange(20.0, 29.6, 0.5))
    for step in range(30):
        time = 30.0 + 0.1 * step
        buffer.add(time - back, way(time))
        if step % 5 == 4:
            assert not images(clock, [time - back])
            assert clock.now == pytest.approx(time - back)


@pytest.mark.parametrize("back", [3.0, 10.0, 25.0])
def test_images_alone_are_brought_to_the_clock_of_odometry(back: float) -> None:
    buffer = OdometryBuffer(MotionSettings())
    clock = ImageClock(MotionSettings(), buffer)
    told = []
    for step in range(500):
        time = 0.1 * step
        buffer.add(time, way(time))
        if step % 5 == 0:
            # Never the very stamp of another image.
            told += images(clock, [time if time < 30.0 else time - back + 0.013])
    assert [finding.reason for finding in told] == [Reason.CLOCK_SET_BACK]
    assert clock.offset_s == pytest.approx(back, abs=0.02)
    assert clock.now == pytest.approx(time - 0.4, abs=0.1)


@pytest.mark.parametrize("held", [1, 2, 4, 8])
@pytest.mark.parametrize("with_odometry", [True, False])
def test_images_that_were_held_up_and_come_together_are_late(held: int, with_odometry: bool) -> None:
    """Each comes where one was missing, however many in a row."""
    clock = ImageClock(MotionSettings(), driven(40.0) if with_odometry else OdometryBuffer(MotionSettings()))
    stamps = np.arange(0.0, 38.0, 0.7)
    order = [*stamps[: 40 - held], stamps[40], *stamps[40 - held : 40], *stamps[41:]]
    assert not images(clock, order)
    assert clock.offset_s == 0.0
    assert clock.now == stamps[-1]


def test_images_alone_without_odometry_go_on_from_there() -> None:
    clock = ImageClock(MotionSettings(), OdometryBuffer(MotionSettings()))
    told = images(clock, [*np.arange(0.0, 20.0, 1.0), *np.arange(12.5, 18.0, 1.0)])
    assert [finding.reason for finding in told] == [Reason.CLOCK_SET_BACK]
    assert clock.now == 17.5


@pytest.mark.parametrize("gap", [11.0, 25.0, 60.0])
def test_sparse_images_without_odometry_count(gap: float) -> None:
    clock = ImageClock(MotionSettings(), OdometryBuffer(MotionSettings()))
    rng = np.random.default_rng(0)
    told = images(clock, np.cumsum(gap * rng.uniform(0.8, 1.2, 20)))
    # The second image alone cannot tell.
    assert [finding.reason for finding in told] == [Reason.STAMP_AHEAD] * (gap > 15.0)

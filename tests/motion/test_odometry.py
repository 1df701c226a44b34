import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.config.model import MotionSettings
from panoloc_mcl.geometry import angle_difference, between, compose
from panoloc_mcl.motion import Motion, OdometryBuffer

SETTINGS = MotionSettings()
# Time stamps as robots have them; they resolve 0.2 microseconds.
T0 = 1.7e9


def drive(seed: int, count: int = 30, period: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    steps = np.column_stack([rng.uniform(0.0, 0.1, count), rng.uniform(-0.01, 0.01, count), rng.uniform(-0.3, 0.3, count)])
    poses = [rng.uniform(-5.0, 5.0, 3)]
    for step in steps[1:]:
        poses.append(compose(poses[-1], step))
    return T0 + period * np.arange(count) + rng.uniform(0.0, 0.04, count), np.array(poses)


def buffer_of(times, poses, settings: MotionSettings = SETTINGS) -> OdometryBuffer:
    buffer = OdometryBuffer(settings)
    for time, pose in zip(times, poses, strict=True):
        buffer.add(float(time), pose)
    return buffer


def same(a: Motion, b: Motion) -> bool:
    figures = [(m.sd_position, m.sd_heading, m.distance, m.turn, m.blind_s) for m in (a, b)]
    return np.array_equal(a.increment, b.increment) and figures[0] == figures[1]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1000), st.floats(-0.5, 4.0), st.floats(-0.5, 4.0), st.sampled_from([30.0, 1.0]))
def test_any_order_of_arrival_gives_the_same_motion(seed: int, start: float, end: float, kept: float) -> None:
    times, poses = drive(seed)
    settings_ = MotionSettings(buffer_s=kept)
    order = np.random.default_rng(seed + 1).permutation(len(times))
    one, other = buffer_of(times, poses, settings_), buffer_of(times[order], poses[order], settings_)
    assert len(one) == len(other)
    assert one.oldest == other.oldest
    assert same(one.motion(T0 + start, T0 + end), other.motion(T0 + start, T0 + end))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1000), st.floats(-1.0, 6.0), st.floats(-1.0, 6.0))
def test_there_and_back_again_is_where_it_was(seed: int, start: float, end: float) -> None:
    buffer = buffer_of(*drive(seed))
    there, back = buffer.motion(T0 + start, T0 + end), buffer.motion(T0 + end, T0 + start)
    assert compose(there.increment, back.increment) == pytest.approx(np.zeros(3), abs=1e-12)
    assert (there.distance, there.turn, there.sd_position, there.sd_heading) == pytest.approx(
        (back.distance, back.turn, back.sd_position, back.sd_heading)
    )


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1000), st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_motions_chain(seed: int, a: float, b: float, c: float) -> None:
    a, b, c = sorted((a, b, c))
    buffer = buffer_of(*drive(seed))
    first, second, whole = buffer.motion(T0 + a, T0 + b), buffer.motion(T0 + b, T0 + c), buffer.motion(T0 + a, T0 + c)
    chained = compose(first.increment, second.increment)
    assert chained[:2] == pytest.approx(whole.increment[:2], abs=1e-9)
    assert abs(float(angle_difference(chained[2], whole.increment[2]))) < 1e-9
    # A corner cut by the stamp in the middle of a step cannot make the way longer.
    assert first.distance + second.distance == pytest.approx(whole.distance, abs=1e-9)
    assert first.turn + second.turn == pytest.approx(whole.turn, abs=1e-9)


def test_between_two_samples_the_motion_is_theirs() -> None:
    times, poses = drive(1)
    motion = buffer_of(times, poses).motion(float(times[3]), float(times[9]))
    assert motion.increment == pytest.approx(between(poses[3], poses[9]), abs=1e-9)
    lengths = np.hypot(*np.diff(poses[3:10, :2], axis=0).T)
    turns = np.abs(angle_difference(poses[4:10, 2], poses[3:9, 2]))
    assert motion.distance == pytest.approx(lengths.sum())
    assert motion.turn == pytest.approx(turns.sum())
    s = SETTINGS
    assert motion.sd_position == pytest.approx(
        math.hypot(s.translation_noise_from_translation * motion.distance, s.translation_noise_from_rotation * motion.turn)
    )
    assert motion.sd_heading == pytest.approx(
        math.hypot(s.rotation_noise_from_rotation * motion.turn, s.rotation_noise_from_translation * motion.distance)
    )
    assert motion.blind_s == 0.0


def test_a_way_there_and_back_is_noise_though_it_ends_where_it_began() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    motion = buffer_of([0.0, 1.0, 2.0], poses).motion(0.0, 2.0)
    assert motion.increment == pytest.approx(np.zeros(3))
    assert motion.distance == pytest.approx(2.0)
    assert motion.sd_position > 0.0


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.floats(-20.0, 20.0)).map(np.array),
    st.floats(0.0, 1.5),
    st.floats(0.0, 1.5),
)
def test_standing_still_is_no_motion_and_no_noise_at_all(pose: np.ndarray, start: float, end: float) -> None:
    buffer = buffer_of(T0 + 0.1 * np.arange(12), np.tile(pose, (12, 1)))
    motion = buffer.motion(T0 + start, T0 + end)
    assert not motion.increment.any()
    assert motion.distance == motion.turn == motion.sd_position == motion.sd_heading == motion.blind_s == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_counted_and_left_out(bad: float) -> None:
    buffer = buffer_of([0.0, 1.0], np.zeros((2, 3)))
    assert not buffer.add(bad, np.zeros(3))
    assert not buffer.add(2.0, np.array([0.0, bad, 0.0]))
    assert buffer.rejected == {"not finite": 2}
    assert len(buffer) == 2


def test_of_two_poses_with_one_stamp_the_first_counts() -> None:
    buffer = buffer_of([0.0, 1.0], np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert not buffer.add(1.0, np.array([9.0, 0.0, 0.0]))
    assert buffer.rejected == {"duplicated time stamp": 1}
    assert buffer.motion(0.0, 1.0).distance == pytest.approx(1.0)


@pytest.mark.parametrize("shape", [(2,), (4,), (1, 3), ()])
def test_a_pose_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="shape"):
        OdometryBuffer(SETTINGS).add(0.0, np.zeros(shape))


def test_callers_may_fill_the_same_array_again() -> None:
    buffer = OdometryBuffer(SETTINGS)
    pose = np.zeros(3)
    for step in range(5):
        pose[0] = step
        buffer.add(float(step), pose)
    assert buffer.motion(0.0, 4.0).distance == pytest.approx(4.0)


def test_headings_may_count_whole_turns() -> None:
    turning = np.column_stack([np.zeros((40, 2)), 0.4 * np.arange(40)])
    motion = buffer_of(0.1 * np.arange(40), turning).motion(0.05, 3.85)
    assert motion.turn == pytest.approx(0.4 * 38)
    assert abs(float(angle_difference(motion.increment[2], 0.4 * 38))) < 1e-9


def steady(speed: float, period: float, until: float) -> OdometryBuffer:
    times = np.arange(0.0, until + 1e-9, period)
    return buffer_of(times, np.column_stack([speed * times, 0.0 * times, 0.0 * times]))


def test_the_last_speed_is_carried_on_up_to_the_limit() -> None:
    buffer = steady(1.0, 1.0, 3.0)
    limit = SETTINGS.max_extrapolation_s
    for ahead in (0.1, limit, limit + 5.0):
        motion = buffer.motion(3.0, 3.0 + ahead)
        assert motion.increment[0] == pytest.approx(min(ahead, limit))
        assert motion.blind_s == pytest.approx(max(0.0, ahead - limit))


def test_past_the_limit_the_robot_may_have_gone_anywhere_its_speed_allows() -> None:
    buffer = steady(0.0, 0.1, 3.0)
    blind = [buffer.motion(3.0, 3.0 + SETTINGS.max_extrapolation_s + seconds) for seconds in (0.0, 1.0, 2.0, 100.0)]
    assert [motion.blind_s for motion in blind] == pytest.approx([0.0, 1.0, 2.0, 100.0], abs=1e-9)
    speed = SETTINGS.image_only_speed_m_s
    assert [motion.sd_position for motion in blind] == pytest.approx(
        [speed * seconds / math.sqrt(3.0) for seconds in (0.0, 1.0, 2.0, 100.0)], abs=1e-9
    )
    # No heading is more uncertain than the uniform one.
    assert blind[-1].sd_heading == pytest.approx(math.pi / math.sqrt(3.0))


def test_without_any_odometry_all_the_time_is_blind() -> None:
    motion = OdometryBuffer(SETTINGS).motion(5.0, 7.0)
    assert not motion.increment.any()
    assert motion.blind_s == 2.0
    assert motion.sd_position > 0.0
    assert motion.sd_heading > 0.0
    assert OdometryBuffer(SETTINGS).motion(5.0, 5.0).sd_position == 0.0


def test_before_the_first_pose_the_robot_stands() -> None:
    motion = steady(1.0, 0.5, 3.0).motion(-2.0, 1.0)
    assert motion.increment[0] == pytest.approx(1.0)
    assert motion.blind_s == 0.0


def test_one_pose_alone_stands() -> None:
    motion = buffer_of([1.0], np.array([[3.0, 4.0, 1.0]])).motion(0.5, 1.4)
    assert not motion.increment.any()
    assert motion.sd_position == 0.0


def test_old_odometry_is_dropped_and_the_window_stays_whole() -> None:
    buffer = OdometryBuffer(MotionSettings(buffer_s=2.0))
    for step in range(1000):
        buffer.add(0.1 * step, np.array([0.1 * step, 0.0, 0.0]))
    assert len(buffer) <= 23
    assert buffer.oldest <= 99.9 - 2.0
    assert buffer.motion(97.95, 99.85).distance == pytest.approx(1.9)

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.geometry import angle_difference, between, compose
from panoloc_mcl.robot.motion import Motion, OdometryBuffer
from panoloc_mcl.robot.motion.models import carried
from panoloc_mcl.robot.settings.localizer import MotionSettings

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
    return np.array_equal(a.increment, b.increment) and figures(a) == figures(b)


def figures(m: Motion) -> tuple[float, ...]:
    noise = (m.sd_first_turn, m.sd_along, m.sd_across, m.sd_last_turn)
    return (m.first_turn, m.along, m.across, m.last_turn, *noise, m.distance, m.turn, m.blind_s, m.duration_s)


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
    assert (there.distance, there.turn, there.sd_along, there.sd_heading, there.duration_s) == pytest.approx(
        (back.distance, back.turn, back.sd_along, back.sd_heading, -back.duration_s)
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
    assert motion.blind_s == 0.0


def test_a_way_there_and_back_is_noise_though_it_ends_where_it_began() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    motion = buffer_of([0.0, 1.0, 2.0], poses).motion(0.0, 2.0)
    assert motion.increment == pytest.approx(np.zeros(3))
    assert motion.distance == pytest.approx(2.0)
    assert motion.sd_along > 0.0
    assert motion.sd_heading > 0.0


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
    assert motion.stands
    assert not any(figures(motion)[:-1])


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
    for along in (True, False):
        assert [motion.sd_along if along else motion.sd_across for motion in blind] == pytest.approx(
            [speed * seconds / math.sqrt(3.0) for seconds in (0.0, 1.0, 2.0, 100.0)], abs=1e-9
        )
    # No heading is more uncertain than the uniform one.
    assert blind[-1].sd_heading == pytest.approx(math.pi / math.sqrt(3.0))


def test_without_any_odometry_all_the_time_is_blind() -> None:
    motion = OdometryBuffer(SETTINGS).motion(5.0, 7.0)
    assert not motion.increment.any()
    assert motion.blind_s == 2.0
    assert motion.sd_along > 0.0
    assert motion.sd_heading > 0.0
    assert OdometryBuffer(SETTINGS).motion(5.0, 5.0).stands


def test_before_the_first_pose_the_robot_stands() -> None:
    motion = steady(1.0, 0.5, 3.0).motion(-2.0, 1.0)
    assert motion.increment[0] == pytest.approx(1.0)
    assert motion.blind_s == 0.0


def test_long_before_the_first_pose_nothing_is_known() -> None:
    buffer = steady(1.0, 0.5, 3.0)
    assert buffer.motion(-1001.0, -1000.0).blind_s == pytest.approx(1.0)
    assert buffer.motion(-20.0, 1.0).blind_s == pytest.approx(20.0 - SETTINGS.clock_jump_s)


def test_one_pose_alone_tells_nothing_of_what_follows() -> None:
    buffer = buffer_of([1.0], np.array([[3.0, 4.0, 1.0]]))
    assert buffer.motion(0.5, 1.0).stands
    later = buffer.motion(0.5, 1.4)
    assert not later.increment.any()
    assert later.blind_s == pytest.approx(0.4)
    assert later.sd_along > 0.0


@settings(max_examples=40, deadline=None)
@given(st.floats(0.02, 2.0), st.integers(2, 40), st.floats(0.0, 3.0))
def test_beyond_the_last_pose_there_is_motion_or_noise(period: float, count: int, ahead: float) -> None:
    """At every rate of odometry: what is not carried on is blind, with nothing in between."""
    times = period * np.arange(count)
    buffer = buffer_of(times, np.column_stack([times, 0.0 * times, 0.0 * times]))
    motion = buffer.motion(float(times[-1]), float(times[-1]) + ahead)
    assert motion.along + motion.blind_s == pytest.approx(ahead, abs=1e-9)
    assert motion.along <= SETTINGS.max_extrapolation_s + 1e-9


def test_what_is_carried_on_is_the_mean_speed_and_not_the_last_jitter() -> None:
    times = np.r_[np.arange(0.0, 2.0, 0.1), 1.901]
    way = np.r_[0.5 * np.arange(0.0, 2.0, 0.1), 0.5 * 1.9 + 0.02]
    motion = buffer_of(times, np.column_stack([way, 0.0 * way, 0.0 * way])).motion(1.901, 2.2)
    assert motion.increment[0] == pytest.approx(0.5 * 0.299, rel=0.1)


def test_old_odometry_is_dropped_and_the_window_stays_whole() -> None:
    buffer = OdometryBuffer(MotionSettings(buffer_s=2.0))
    for step in range(1000):
        buffer.add(0.1 * step, np.array([0.1 * step, 0.0, 0.0]))
    assert len(buffer) <= 23
    assert buffer.oldest <= 99.9 - 2.0
    assert buffer.motion(97.95, 99.85).distance == pytest.approx(1.9)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-1.0, 1.0)), min_size=1, max_size=8))
@pytest.mark.parametrize("model", ["differential", "omnidirectional"])
def test_the_parts_put_together_are_the_motion(model: str, steps: list[tuple[float, float, float]]) -> None:
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], np.array(step)))
    motion = buffer_of(0.1 * np.arange(len(poses)), poses, MotionSettings(model=model)).motion(0.0, 0.1 * len(steps))
    for parts, whole in ((motion, motion.increment), (motion.reversed(), motion.reversed().increment)):
        turned = compose(np.array([0.0, 0.0, parts.first_turn]), np.array([parts.along, parts.across, 0.0]))
        together = compose(turned, np.array([0.0, 0.0, parts.last_turn]))
        assert together[:2] == pytest.approx(whole[:2], abs=1e-9)
        # Half a turn to the left is half a turn to the right.
        assert float(angle_difference(together[2], whole[2])) == pytest.approx(0.0, abs=1e-9)
    # What lies behind is driven backwards.
    assert abs(motion.first_turn) <= 0.5 * math.pi + 1e-12


def one_step(dx: float, dy: float, turn: float, model: str = "differential", **noise) -> Motion:
    noise = {name: 0.0 for name in MotionSettings.model_fields if "noise" in name} | noise
    return buffer_of([0.0, 1.0], [np.zeros(3), np.array([dx, dy, turn])], MotionSettings(model=model, **noise)).motion(0.0, 1.0)


def test_the_differential_model_is_that_of_the_textbook() -> None:
    """On an arc, the two turns are half the change of heading each; alphas are the squares of the parameters."""
    a1, a2, a3, a4 = 0.1, 0.05, 0.15, 0.02
    angle = 0.6
    motion = one_step(
        math.sin(angle), 1.0 - math.cos(angle), angle,
        rotation_noise_from_rotation=a1, rotation_noise_from_translation=a2,
        translation_noise_from_translation=a3, translation_noise_from_rotation=a4,
    )  # fmt: skip
    chord = 2.0 * math.sin(angle / 2.0)
    assert (motion.first_turn, motion.last_turn) == pytest.approx((angle / 2.0, angle / 2.0))
    assert motion.along == pytest.approx(chord)
    turn = math.sqrt(a1**2 * (angle / 2.0) ** 2 + a2**2 * chord**2)
    assert (motion.sd_first_turn, motion.sd_last_turn) == pytest.approx((turn, turn))
    assert motion.sd_along == pytest.approx(math.sqrt(a3**2 * chord**2 + a4**2 * 2.0 * (angle / 2.0) ** 2))
    assert motion.sd_across == 0.0


def test_the_omnidirectional_model_is_that_of_beluga() -> None:
    a1, a2, a3, a4, a5 = 0.1, 0.05, 0.15, 0.02, 0.3
    motion = one_step(
        0.3, 0.4, -0.5, "omnidirectional",
        rotation_noise_from_rotation=a1, rotation_noise_from_translation=a2, translation_noise_from_translation=a3,
        translation_noise_from_rotation=a4, strafe_noise_from_translation=a5,
    )  # fmt: skip
    assert motion.first_turn == pytest.approx(math.atan2(0.4, 0.3))
    assert motion.along == pytest.approx(0.5)
    assert motion.sd_first_turn == 0.0
    assert motion.sd_along == pytest.approx(math.hypot(a3 * 0.5, a4 * 0.5))
    assert motion.sd_across == pytest.approx(math.hypot(a5 * 0.5, a4 * 0.5))
    assert motion.sd_last_turn == pytest.approx(math.hypot(a1 * 0.5, a2 * 0.5))


def test_driving_backwards_is_no_turn() -> None:
    motion = one_step(-1.0, 0.0, 0.0, rotation_noise_from_rotation=1.0)
    assert (motion.first_turn, motion.along, motion.last_turn) == pytest.approx((0.0, -1.0, 0.0))
    assert motion.sd_heading == 0.0


@pytest.mark.parametrize("name", [name for name in MotionSettings.model_fields if "noise" in name])
@pytest.mark.parametrize("model", ["differential", "omnidirectional"])
def test_each_parameter_makes_its_noise(name: str, model: str) -> None:
    motion = one_step(1.0, 0.0, 0.4, model, **{name: 0.1})
    across = motion.sd_across
    found = {"rotation": motion.sd_heading, "translation": motion.sd_along, "strafe": across, "slip": across}
    kind = name.split("_")[0]
    # A robot with two wheels cannot drive sideways; it only slips.
    only = {"strafe": "omnidirectional", "slip": "differential"}
    assert (found[kind] > 0.0) == (only.get(kind, model) == model)
    if model == "differential" and kind != "slip":
        assert across == 0.0


def test_slip_grows_with_the_way() -> None:
    """Between images a decimetre apart odometry errs sideways by a share of the way, not of its square."""
    for way in (0.1, 0.2, 0.4):
        motion = one_step(way, 0.0, 0.0, slip_noise_from_translation=0.03)
        assert motion.sd_across == pytest.approx(0.03 * way)
        assert one_step(-way, 0.0, 0.0, slip_noise_from_translation=0.03).sd_across == pytest.approx(0.03 * way)
    _, covariance = carried(np.zeros(3), np.zeros((3, 3)), one_step(0.1, 0.0, 0.0, slip_noise_from_translation=0.03))
    assert covariance[1, 1] == pytest.approx(0.003**2)


def test_the_stationary_model_reads_no_odometry() -> None:
    times = 0.1 * np.arange(20)
    buffer = buffer_of(times, np.column_stack([times, times, times]), MotionSettings(model="stationary"))
    motion = buffer.motion(0.5, 1.5)
    assert not motion.increment.any()
    assert motion.blind_s == pytest.approx(1.0)
    assert motion.sd_along == motion.sd_across == pytest.approx(SETTINGS.image_only_speed_m_s / math.sqrt(3.0))
    assert buffer.motion(1.0, 1.0).stands


LIMITED = MotionSettings(max_speed_m_s=1.0, max_turn_rate_deg_s=90.0)
UNLIMITED = MotionSettings(max_speed_m_s=None, max_turn_rate_deg_s=None)


@pytest.mark.parametrize("jump", [(3.0, 0.0, 0.0), (0.0, -9.0, 0.0), (0.0, 0.0, 2.0)])
def test_a_jump_beyond_the_robot_is_left_out_and_counted(jump: tuple[float, float, float]) -> None:
    times = 0.1 * np.arange(20)
    poses = np.column_stack([0.5 * times, 0.0 * times, 0.0 * times])
    poses[10] += jump
    buffer = buffer_of(times, poses, LIMITED)
    assert buffer.rejected == {"a jump beyond what the robot can do": 1}
    assert buffer.motion(0.0, 1.9).distance == pytest.approx(0.95)
    assert not buffer.events
    assert not buffer_of(times, poses, UNLIMITED).rejected


def test_odometry_that_begins_anew_goes_on_from_there() -> None:
    times = 0.1 * np.arange(40)
    poses = np.column_stack([0.5 * times, 0.0 * times, 0.0 * times])
    poses[20:, 0] -= poses[20, 0] + 7.0
    buffer = buffer_of(times, poses, LIMITED)
    assert buffer.rejected == {"a jump beyond what the robot can do": 1}
    assert buffer.events == {"it began from a new origin": 1}
    # One step of 5 cm is lost: what happened while the origin changed, nobody knows.
    assert buffer.motion(0.0, 3.9).distance == pytest.approx(0.5 * 3.9 - 0.05)


def test_one_stamp_far_ahead_harms_nothing() -> None:
    buffer = steady(1.0, 0.1, 3.0)
    assert not buffer.add(1e6, np.array([50.0, 0.0, 0.0]))
    assert buffer.add(3.1, np.array([3.1, 0.0, 0.0]))
    assert sum(buffer.rejected.values()) == 1
    assert buffer.motion(0.0, 3.1).distance == pytest.approx(3.1)
    # Nor do two that have nothing to do with each other.
    assert not buffer.add(2e6, np.zeros(3))
    assert not buffer.add(9e6, np.zeros(3))
    assert buffer.newest == 3.1


@pytest.mark.parametrize("shift", [1e6, -1e6])
def test_a_clock_that_jumps_for_good_is_followed(shift: float) -> None:
    buffer = steady(1.0, 0.1, 3.0)
    taken = [buffer.add(3.1 + shift + 0.1 * step, np.array([3.1 + 0.1 * step, 0.0, 0.0])) for step in range(10)]
    assert taken == [False] + [True] * 9
    assert buffer.events == {"its clock jumped": 1}
    assert buffer.motion(3.1 + shift, 4.0 + shift).distance == pytest.approx(0.9)


def test_what_is_too_old_is_counted() -> None:
    buffer = OdometryBuffer(MotionSettings(buffer_s=2.0))
    for step in range(100):
        buffer.add(0.1 * step, np.zeros(3))
    assert not buffer.add(5.05, np.zeros(3))
    assert buffer.rejected == {"older than what is kept": 1}


@pytest.mark.parametrize("settings_", [SETTINGS, LIMITED])
def test_restored_it_goes_on_as_if_nothing_had_happened(settings_: MotionSettings) -> None:
    times, poses = drive(3, 60)
    poses[30:] = compose(np.array([5.0, 2.0, 1.0]), poses[30:])
    buffer = buffer_of(times[:31], poses[:31], settings_)
    buffer.add(math.nan, poses[0])
    other = OdometryBuffer(settings_)
    arrays, header = buffer.snapshot()
    other.restore({name: array.copy() for name, array in arrays.items()}, header)
    for one in (buffer, other):
        for time, pose in zip(times[31:], poses[31:], strict=True):
            one.add(float(time), pose)
    assert same(buffer.motion(T0 + 0.3, T0 + 6.0), other.motion(T0 + 0.3, T0 + 6.0))
    assert (buffer.rejected, buffer.events) == (other.rejected, other.events)

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.geometry import (
    angle_difference,
    between,
    circular_mean,
    compose,
    fitted_motion,
    interpolate,
    interpolate_at,
    inverse,
    wrap_angle,
    yaw_from_quaternion,
)

angles = st.floats(-1e3, 1e3)
metres = st.floats(-1e3, 1e3)
poses = st.tuples(metres, metres, angles).map(np.array)
# Coordinates of 1e3 m, turned, lose about 1e3 x 2^-52 a step.
NEAR = 1e-9


def assert_same_pose(a: np.ndarray, b: np.ndarray, tolerance: float = NEAR) -> None:
    assert np.abs(a[..., :2] - b[..., :2]).max() < tolerance
    assert np.abs(angle_difference(a[..., 2], b[..., 2])).max() < tolerance


@given(st.floats(allow_nan=False, allow_infinity=False))
@example(np.pi)
@example(-np.pi)
@example(np.nextafter(np.pi, 0.0))
@example(np.nextafter(-np.pi, -4.0))
@example(3.0 * np.pi)
@example(-1e-17)
@example(1e300)
def test_wrapped_angles_lie_in_the_range_and_stay(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    assert float(wrap_angle(wrapped)) == wrapped
    if -np.pi <= angle < np.pi:
        assert wrapped == angle


@given(st.floats())
@example(np.pi)
@example(-np.pi)
@example(np.nextafter(np.pi, 0.0))
@example(np.nextafter(-np.pi, -4.0))
@example(-0.0)
@example(1e300)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_one_angle_is_wrapped_as_many_are(angle: float) -> None:
    """To the last bit, whatever it is given as."""
    (among,) = wrap_angle([angle])
    for one in (wrap_angle(angle), wrap_angle(np.float64(angle)), wrap_angle(np.array(angle)), angle_difference(angle, 0.0)):
        assert np.shape(one) == ()
        np.testing.assert_equal(float(one), float(among))


@given(st.floats(-np.pi, np.nextafter(np.pi, 0.0)), st.integers(-1000, 1000))
def test_whole_turns_change_nothing(angle: float, turns: int) -> None:
    assert abs(float(angle_difference(angle + turns * 2.0 * np.pi, angle))) < 1e-11


@given(angles, angles)
def test_the_difference_leads_from_one_angle_to_the_other(a: float, b: float) -> None:
    assert np.exp(1j * (b + float(angle_difference(a, b)))) == pytest.approx(np.exp(1j * a), abs=1e-11)


@given(arrays(np.float64, st.integers(1, 8), elements=st.floats(-1.5, 1.5)), angles)
def test_the_circular_mean_turns_with_its_angles(spread: np.ndarray, turn: float) -> None:
    # All within a half circle, so the mean exists.
    mean = circular_mean(spread)
    assert spread.min() - NEAR <= mean <= spread.max() + NEAR
    assert abs(float(angle_difference(circular_mean(spread + turn), mean + turn))) < 1e-9


@given(arrays(np.float64, 5, elements=st.floats(-1.0, 1.0)), arrays(np.int64, 5, elements=st.integers(1, 4)))
def test_a_weight_of_two_is_the_angle_twice(a: np.ndarray, counts: np.ndarray) -> None:
    assert circular_mean(a, counts) == pytest.approx(circular_mean(np.repeat(a, counts)), abs=1e-12)


def test_the_mean_over_the_seam_is_at_the_seam() -> None:
    assert abs(abs(circular_mean([np.pi - 0.1, -np.pi + 0.1])) - np.pi) < 1e-12
    assert np.isfinite(circular_mean([0.0, np.pi]))


@given(poses, poses, poses)
def test_poses_form_a_group(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    origin = np.zeros(3)
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)), 1e-8)
    assert_same_pose(compose(a, inverse(a)), origin)
    assert_same_pose(compose(inverse(a), a), origin)
    assert_same_pose(inverse(inverse(a)), a)
    assert_same_pose(inverse(compose(a, b)), compose(inverse(b), inverse(a)), 1e-8)
    assert np.array_equal(compose(a, origin)[:2], a[:2])


@given(poses, poses)
def test_between_is_what_compose_undoes(a: np.ndarray, b: np.ndarray) -> None:
    assert_same_pose(compose(a, between(a, b)), b)
    assert_same_pose(between(a, b), compose(inverse(a), b), 1e-8)


@given(st.tuples(st.floats(-1e7, 1e7), st.floats(-1e7, 1e7), st.floats(-50.0, 50.0)).map(np.array))
def test_from_a_pose_to_itself_is_exactly_nothing(a: np.ndarray) -> None:
    assert not between(a, a).any()


@given(poses, st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0)).map(np.array))
def test_compose_is_the_product_of_homogeneous_matrices(a: np.ndarray, b: np.ndarray) -> None:
    def matrix(pose: np.ndarray) -> np.ndarray:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])

    assert np.allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=NEAR)


def test_shapes_broadcast() -> None:
    many = np.random.default_rng(0).normal(size=(4, 1, 3))
    assert compose(many, np.zeros((5, 3))).shape == (4, 5, 3)
    assert between(many[0, 0], many).shape == (4, 1, 3)
    assert interpolate(many[:, 0], many[0, 0], 0.5).shape == (4, 3)


@given(poses, poses, st.floats(0.0, 1.0))
def test_interpolation_takes_the_shorter_arc(a: np.ndarray, b: np.ndarray, fraction: float) -> None:
    between_them = interpolate(a, b, fraction)
    whole = float(angle_difference(b[2], a[2]))
    part = float(angle_difference(between_them[2], a[2]))
    # Right at half a turn both ways are equally short.
    if abs(abs(fraction * whole) - np.pi) > 1e-9:
        assert part == pytest.approx(fraction * whole, abs=1e-9)
    assert between_them[:2] == pytest.approx((1.0 - fraction) * a[:2] + fraction * b[:2], abs=NEAR)
    assert_same_pose(interpolate(a, b, 0.0), a)
    assert_same_pose(interpolate(a, b, 1.0), b)


@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_a_trajectory_is_hit_at_its_samples_and_held_at_its_ends(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = 1.7e9 + np.cumsum(rng.uniform(1e-3, 1.0, count))
    path = rng.uniform([-9.0, -9.0, -np.pi], [9.0, 9.0, np.pi], (count, 3))
    assert_same_pose(interpolate_at(times, path, times), path, 1e-9)
    assert_same_pose(interpolate_at(times, path, times[0] - 5.0), path[0])
    assert_same_pose(interpolate_at(times, path, times[-1] + 5.0), path[-1])
    assert interpolate_at(times, path, np.full((2, 3), times[0])).shape == (2, 3, 3)
    if count > 1:
        middle = 0.5 * (times[:-1] + times[1:])
        # Time stamps of today's date resolve 0.2 microseconds.
        assert_same_pose(interpolate_at(times, path, middle), interpolate(path[:-1], path[1:], 0.5), 1e-2)


@given(angles, st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))
def test_the_yaw_comes_back_from_a_quaternion(yaw: float, pitch: float, roll: float) -> None:
    quaternion = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
    assert abs(float(angle_difference(yaw_from_quaternion(*quaternion), yaw))) < 1e-9
    assert abs(float(angle_difference(yaw_from_quaternion(*-quaternion), yaw))) < 1e-9


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3), st.integers(0, 1000))
def test_the_frame_is_found_whatever_it_is_though_one_pose_is_far_off(x: float, y: float, turn: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    said = np.column_stack([rng.uniform(-5.0, 5.0, (20, 2)), rng.uniform(-3.0, 3.0, 20)])
    motion = np.array([x, y, turn])
    true = compose(motion, said)
    said[3, :2] += 4.0
    found = fitted_motion(said, true)
    np.testing.assert_allclose(compose(found, said)[np.arange(20) != 3], true[np.arange(20) != 3], atol=1e-6)

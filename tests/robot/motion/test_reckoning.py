import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.geometry import angle_difference, compose
from panoloc_mcl.robot.motion import Anchor, OdometryBuffer, carried, carried_to
from panoloc_mcl.robot.settings.localizer import MotionSettings

COVARIANCE = np.array([[4e-4, 1e-4, 2e-5], [1e-4, 9e-4, -3e-5], [2e-5, -3e-5, 1e-3]])


def driven(seed: int, model: str, velocity: bool) -> OdometryBuffer:
    rng = np.random.default_rng(seed)
    buffer = OdometryBuffer(MotionSettings(model=model, max_speed_m_s=None, max_turn_rate_deg_s=None))
    pose = rng.normal(size=3)
    for index in rng.permutation(40) if seed % 2 else range(40):
        pose = compose(pose, rng.normal(scale=0.05, size=3))
        buffer.add(0.1 * index, pose, rng.normal(size=3) if velocity else None, np.eye(3) * 1e-4 * index if velocity else None)
    return buffer


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 1000),
    model=st.sampled_from(["differential", "omnidirectional", "stationary"]),
    velocity=st.booleans(),
    start=st.floats(-0.3, 4.0),
    ahead=st.floats(-1.0, 6.0),
)
# Both times beyond the newest measurement, on an arc.
@example(seed=0, model="differential", velocity=True, start=4.0, ahead=1.0)
def test_it_is_the_way_that_odometry_knows(seed: int, model: str, velocity: bool, start: float, ahead: float) -> None:
    buffer = driven(seed, model, velocity)
    anchor = Anchor(start, np.array([1.0, -2.0, 3.0]), COVARIANCE)
    pose, covariance = carried_to(anchor, buffer, start + ahead)
    true_pose, true_covariance = carried(anchor.pose, anchor.covariance, buffer.motion(start, start + ahead))
    assert pose[:2] == pytest.approx(true_pose[:2], abs=1e-9)
    assert abs(angle_difference(pose[2], true_pose[2])) < 1e-9
    assert covariance == pytest.approx(true_covariance, abs=1e-9)


def test_without_odometry_the_robot_may_be_anywhere_it_can_drive_to() -> None:
    buffer = OdometryBuffer(MotionSettings())
    pose, covariance = carried_to(Anchor(1.0, np.zeros(3), np.zeros((3, 3))), buffer, 4.0)
    assert np.array_equal(pose, np.zeros(3))
    assert np.sqrt(covariance[0, 0]) == pytest.approx(MotionSettings().image_only_speed_m_s * 3.0 / np.sqrt(3.0))


def test_a_velocity_carries_on_along_an_arc() -> None:
    buffer = OdometryBuffer(MotionSettings(max_extrapolation_s=1.0))
    buffer.add(0.0, np.zeros(3), np.array([1.0, 0.0, np.pi]))
    pose, _ = carried_to(Anchor(0.0, np.zeros(3), np.zeros((3, 3))), buffer, 0.5)
    # A quarter of a circle of radius 1 / pi.
    assert pose == pytest.approx([1.0 / np.pi, 1.0 / np.pi, np.pi / 2.0])


def test_the_covariance_of_odometry_counts_if_it_grows_more_than_the_models() -> None:
    buffer = OdometryBuffer(MotionSettings())
    for index in range(11):
        buffer.add(0.1 * index, np.array([0.01 * index, 0.0, 0.0]), covariance=np.diag([0.04, 0.04, 0.01]) * index)
    motion = buffer.motion(0.0, 1.0)
    assert motion.sd_along == pytest.approx(np.sqrt(0.4))
    assert motion.sd_last_turn == pytest.approx(np.sqrt(0.1))
    buffer = OdometryBuffer(MotionSettings())
    for index in range(11):
        buffer.add(0.1 * index, np.array([0.01 * index, 0.0, 0.0]), covariance=np.full((3, 3), np.nan))
    assert buffer.motion(0.0, 1.0).sd_along < 0.05

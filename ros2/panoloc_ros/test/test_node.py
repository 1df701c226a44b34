"""The node for real: two processes, real messages, real time."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from lifecycle_msgs.msg import Transition
from panoloc_ros.conversions import pose_of, ros_covariance, ros_pose
from std_srvs.srv import Empty


def off(message: PoseWithCovarianceStamped, drive, robot) -> float:
    stamp = message.header.stamp
    pose = pose_of(message.pose.pose)
    return float(np.hypot(*(pose[:2] - drive.groundtruth.at(stamp.sec + stamp.nanosec / 1e9)[:2])))


def activate(robot) -> None:
    assert robot.change(Transition.TRANSITION_CONFIGURE)
    assert robot.change(Transition.TRANSITION_ACTIVATE)
    assert robot.state() == "active"


def test_a_drive_in_real_time(start, robot, map_file, drive, tmp_path) -> None:
    state = tmp_path / "state.npz"
    node = start(f"map_file:={map_file}", f"state_file:={state}", "save_pose_rate:=5.0")
    assert robot.state() == "unconfigured"
    assert robot.change(Transition.TRANSITION_CONFIGURE)
    robot.play(drive, 0, 2)
    # Not active: nothing is answered.
    assert not robot.transforms
    assert not robot.poses
    assert robot.change(Transition.TRANSITION_ACTIVATE)
    # Odometry alone: no transform before the first fix.
    robot.send_odometry(float(drive.times[1]), drive.odometry.at(drive.times[1]))
    robot.spin(0.5)
    assert not robot.transforms
    # The first image compiles; what is measured begins after it.
    robot.play(drive, 2, 3)
    robot.until(lambda: robot.poses, 90.0)
    robot.transforms.clear()
    robot.play(drive, 3, 12)
    errors = robot.base_errors(drive)
    print(
        f"{len(errors)} transforms, median error {1e3 * np.median(errors):.1f} mm, p95 {1e3 * np.percentile(errors, 95):.1f} mm"
    )
    span = float(drive.times[11] - drive.times[3])
    assert len(errors) > 0.8 * 50.0 * span
    assert np.median(errors) <= 0.005
    assert len(robot.poses) >= 8
    assert max(off(pose, drive, robot) for pose in robot.poses) < 0.05
    covariance = np.array(robot.poses[-1].pose.covariance).reshape(6, 6)
    assert 0.0 < covariance[0, 0] < 0.01
    assert robot.clouds[-1].poses
    robot.until(lambda: robot.diagnostics)
    status = robot.diagnostics[-1].status[0]
    values = {value.key: value.value for value in status.values}
    assert values["status"] == "converged"
    assert float(values["latency, ms"]) > 0.0
    # Killed, and started again: the first transform comes before the first image.
    node.kill()
    robot.transforms.clear()
    robot.poses.clear()
    start(f"map_file:={map_file}", f"state_file:={state}")
    activate(robot)
    stamp = float(drive.times[11]) + 0.5
    for index in range(25):
        robot.send_odometry(stamp + 0.02 * index, drive.odometry.at(stamp + 0.02 * index))
        robot.spin(0.02)
    robot.until(lambda: robot.transforms)
    assert np.median(robot.base_errors(drive)) < 0.1
    robot.play(drive, 13, 14)
    robot.until(lambda: robot.poses)
    assert off(robot.poses[0], drive, robot) < 0.05


def test_poses_that_are_given_services_and_transitions(start, robot, map_file, drive) -> None:
    start(f"map_file:={map_file}")
    activate(robot)
    robot.play(drive, 0, 3)
    robot.until(lambda: robot.poses)
    # The first image is the slowest: wait until the last one is answered, too.
    last = float(drive.times[2]) - 0.01
    robot.until(lambda: robot.poses[-1].header.stamp.sec + robot.poses[-1].header.stamp.nanosec / 1e9 > last)
    wrong = np.array([0.3, -0.4, 0.5])
    given = PoseWithCovarianceStamped()
    given.header.frame_id = "map"
    given.pose.pose = ros_pose(wrong)
    given.pose.covariance = ros_covariance(np.diag([0.01, 0.01, 0.01]))
    robot.given.publish(given)
    robot.spin(1.0)
    robot.transforms.clear()
    stamp = float(drive.times[2]) + 0.4
    robot.send_odometry(stamp, drive.odometry.at(stamp))
    robot.until(lambda: robot.transforms)
    frame = robot.transforms[-1].transform
    driven = drive.odometry.at(stamp)
    turn = 2.0 * np.arctan2(frame.rotation.z, frame.rotation.w)
    believed = np.array([frame.translation.x, frame.translation.y]) + np.array(
        [np.cos(turn) * driven[0] - np.sin(turn) * driven[1], np.sin(turn) * driven[0] + np.cos(turn) * driven[1]]
    )
    assert np.hypot(*(believed - wrong[:2])) < 0.15
    # Asked to find itself anew: the transform is held, the next image tells.
    robot.call(Empty, "reinitialize_global_localization")
    robot.transforms.clear()
    robot.send_odometry(stamp + 0.02, drive.odometry.at(stamp + 0.02))
    robot.until(lambda: robot.transforms)
    robot.poses.clear()
    robot.play(drive, 3, 5)
    robot.until(lambda: robot.poses)
    assert off(robot.poses[-1], drive, robot) < 0.05
    robot.call(Empty, "request_nomotion_update")
    assert robot.change(Transition.TRANSITION_DEACTIVATE)
    robot.poses.clear()
    robot.play(drive, 5, 6)
    assert not robot.poses
    assert robot.change(Transition.TRANSITION_ACTIVATE)
    robot.play(drive, 6, 8)
    assert robot.poses
    assert robot.change(Transition.TRANSITION_DEACTIVATE)
    assert robot.change(Transition.TRANSITION_CLEANUP)
    assert robot.state() == "unconfigured"


def test_a_map_that_is_none_is_said_and_the_node_stays(start, robot) -> None:
    start("map_file:=/nowhere/hall.panomap")
    assert not robot.change(Transition.TRANSITION_CONFIGURE)
    assert robot.state() == "unconfigured"

"""Between ROS messages and the localizer's own: stamps, poses, covariances, images."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseWithCovarianceStamped, TransformStamped

from panoloc_mcl import Image, Odometry
from panoloc_mcl.robot.geometry import yaw_from_quaternion
from panoloc_mcl.tools.datasets.recordings.ros.messages import pixels_of, planar, seconds_of, stamp_ns

# x, y and yaw in ROS's six.
_PLANE = np.ix_([0, 1, 5], [0, 1, 5])


def stamp_of(seconds: float) -> Time:
    """A time in seconds as a ROS stamp."""
    nanoseconds = max(round(seconds * 1e9), 0)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def image_of(message: Any, topic: str) -> Image:
    """A ``sensor_msgs`` Image or CompressedImage; its pixels are decoded when it is its turn."""
    return Image(seconds_of(stamp_ns(message)), partial(pixels_of, message, topic), frame=message.header.frame_id)


def odometry_of(message: Any) -> Odometry | None:
    """A ``nav_msgs`` Odometry; None if its pose is none."""
    pose = pose_of(message.pose.pose)
    if pose is None:
        return None
    twist = message.twist.twist
    velocity = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
    covariance = np.array(message.pose.covariance).reshape(6, 6)[_PLANE]
    # Many drivers fill in nothing, and a robot that drives has some velocity.
    return Odometry(
        seconds_of(stamp_ns(message)),
        pose,
        velocity if velocity.any() else None,
        covariance if covariance.any() else None,
        message.header.frame_id,
    )


def pose_of(pose: Any) -> np.ndarray | None:
    """x, y and yaw of a ``geometry_msgs`` Pose; None if it is none."""
    found = planar(pose.position, pose.orientation)
    if found is None:
        return None
    norm = math.hypot(*found[2:])
    return np.array([found[0], found[1], float(yaw_from_quaternion(*(value / norm for value in found[2:])))])


def given_covariance(message: PoseWithCovarianceStamped) -> np.ndarray | None:
    """Of x, y and yaw; None if nothing is filled in."""
    covariance = np.array(message.pose.covariance).reshape(6, 6)[_PLANE]
    return covariance if covariance.any() else None


def ros_pose(pose: np.ndarray) -> Pose:
    """A pose in the plane."""
    out = Pose()
    out.position.x, out.position.y = float(pose[0]), float(pose[1])
    out.orientation.z, out.orientation.w = math.sin(0.5 * float(pose[2])), math.cos(0.5 * float(pose[2]))
    return out


def ros_covariance(covariance: np.ndarray) -> list[float]:
    """Of x, y and yaw, as ROS's 36 numbers."""
    six = np.zeros((6, 6))
    six[_PLANE] = covariance
    return [float(value) for value in six.reshape(-1)]


def transform(parent: str, child: str, stamp: Time, pose: np.ndarray) -> TransformStamped:
    """The transform between two frames of the plane."""
    out = TransformStamped()
    out.header.frame_id, out.child_frame_id, out.header.stamp = parent, child, stamp
    out.transform.translation.x, out.transform.translation.y = float(pose[0]), float(pose[1])
    out.transform.rotation = ros_pose(pose).orientation
    return out

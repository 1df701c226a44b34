"""A node in a process of its own, and this process as the robot: it plays a drive and looks at what comes back."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Odometry
from panoloc_ros.conversions import pose_of, ros_pose, seconds_of, stamp_of
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image as RosImage

from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Sequence, Trajectory, read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import Image, recorded

PACKAGE = Path(__file__).parents[1]
ODOMETRY_HZ = 50.0


@pytest.fixture(scope="session")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A map that was built before, for those who run the suite again and again.
    if "PANOLOC_TEST_MAP" in os.environ:
        return Path(os.environ["PANOLOC_TEST_MAP"])
    path = tmp_path_factory.mktemp("map") / "hall.panomap"
    cached_map(read_dataset(resolve_dataset("hall")), RunConfig().observation, 0).save(path)
    return path


@pytest.fixture(scope="session")
def drive() -> Sequence:
    """A drive whose odometry, at 50 Hz, belongs to its true poses: steps are 2 % off at random, and all of them 1 % too long.

    Between two images the robot is taken to have gone straight, since nobody knows better.
    """
    found = read_dataset(resolve_dataset("hall")).sequences["evening_00"]
    times = np.arange(found.times[0] - 1.0, found.times[-1] + 1.0, 1.0 / ODOMETRY_HZ)
    true = found.groundtruth.at(times)
    steps = between(true[:-1], true[1:])
    steps *= 1.01 + 0.02 * np.random.default_rng(0).standard_normal((len(steps), 1))
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return replace(found, odometry=Trajectory(times, np.array(poses)))


class Robot:
    """What a robot publishes, and what it hears."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("robot")
        self.images = self.node.create_publisher(RosImage, "image", qos_profile_sensor_data)
        self.odometry = self.node.create_publisher(Odometry, "odom", 100)
        self.given = self.node.create_publisher(PoseWithCovarianceStamped, "initialpose", 1)
        self.transforms: list[TransformStamped] = []
        self.poses: list[PoseWithCovarianceStamped] = []
        self.clouds: list[PoseArray] = []
        self.diagnostics: list[DiagnosticArray] = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for kind, topic, heard, qos in (
            (TransformStamped, "tf_stamped", self.transforms, 1000),
            (PoseWithCovarianceStamped, "pose", self.poses, latched),
            (PoseArray, "particle_cloud", self.clouds, 10),
            (DiagnosticArray, "/diagnostics", self.diagnostics, 10),
        ):
            self.node.create_subscription(kind, topic, heard.append, qos)

    def call(self, kind: Any, name: str, request: Any = None, timeout: float = 60.0) -> Any:
        """Answer of a service."""
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(timeout), f"no service {name}"
        future = client.call_async(request or kind.Request())
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=timeout)
        assert future.done(), f"{name} did not answer"
        self.node.destroy_client(client)
        return future.result()

    def wait_for_node(self, seconds: float = 120.0) -> None:
        """Until the node answers: one that was killed is still announced for a while, and swallows requests."""
        end = time.monotonic() + seconds
        client = self.node.create_client(GetState, "/panoloc/get_state")
        while time.monotonic() < end:
            future = client.call_async(GetState.Request())
            rclpy.spin_until_future_complete(self.node, future, timeout_sec=2.0)
            if future.done():
                self.node.destroy_client(client)
                return
        raise AssertionError("the node does not answer")

    def change(self, transition: int) -> bool:
        """A lifecycle transition of the node."""
        self.wait_for_node()
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.call(ChangeState, "/panoloc/change_state", request, timeout=180.0).success)

    def state(self) -> str:
        return str(self.call(GetState, "/panoloc/get_state").current_state.label)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=left)

    def until(self, met: Callable[[], Any], seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not met() and time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.05)
        assert met(), "did not come in time"

    def send_image(self, image: Image) -> None:
        pixels = image.pixels()
        message = RosImage(height=pixels.shape[0], width=pixels.shape[1], encoding="mono8" if pixels.ndim == 2 else "bgr8")
        message.header.stamp, message.header.frame_id = stamp_of(image.timestamp), "camera"
        message.step = pixels.shape[1] * (1 if pixels.ndim == 2 else pixels.shape[2])
        message.data.frombytes(np.ascontiguousarray(pixels).tobytes())
        self.images.publish(message)

    def send_odometry(self, timestamp: float, pose: np.ndarray) -> None:
        message = Odometry(child_frame_id="base_link")
        message.header.stamp, message.header.frame_id = stamp_of(timestamp), "odom"
        message.pose.pose = ros_pose(pose)
        self.odometry.publish(message)

    def play(self, drive: Sequence, first: int, last: int, rate: float = 1.0, odometry: bool = True) -> None:
        """Images first to last - 1 in real time, odometry at 50 Hz."""
        begin, end = float(drive.times[first]) - 0.3, float(drive.times[last - 1]) + 0.3
        stamps = np.arange(begin, end, 1.0 / ODOMETRY_HZ)
        images = [message for message in recorded(drive) if isinstance(message, Image)][first:last]
        started, pending = time.monotonic(), 0
        for stamp in stamps.tolist():
            while (left := started + (stamp - begin) / rate - time.monotonic()) > 0.0:
                rclpy.spin_once(self.node, timeout_sec=left)
            if odometry:
                self.send_odometry(stamp, drive.odometry.at(stamp))
            if pending < len(images) and images[pending].timestamp <= stamp:
                self.send_image(images[pending])
                pending += 1
        self.spin(0.5)

    def base_errors(self, drive: Sequence, tolerance: float = 0.1) -> np.ndarray:
        """Errors of the transforms heard, with the odometry that belongs to each, against truth: metres."""
        errors = []
        for transform in self.transforms:
            stamp = seconds_of(transform.header.stamp.sec * 10**9 + transform.header.stamp.nanosec) - tolerance
            parts = transform.transform
            frame = pose_of(type("Posed", (), {"position": parts.translation, "orientation": parts.rotation}))
            driven = drive.odometry.at(stamp)
            c, s = np.cos(frame[2]), np.sin(frame[2])
            position = frame[:2] + np.array([c * driven[0] - s * driven[1], s * driven[0] + c * driven[1]])
            errors.append(np.hypot(*(position - drive.groundtruth.at(stamp)[:2])))
        return np.array(errors)


class Node:
    """The node's process."""

    def __init__(self, *parameters: str) -> None:
        words = [word for parameter in parameters for word in ("-p", parameter)]
        environment = os.environ | {"PYTHONPATH": f"{PACKAGE}:{PACKAGE.parents[1]}"}
        self.process = subprocess.Popen([sys.executable, "-m", "panoloc_ros.node", "--ros-args", *words], env=environment)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def start() -> Iterator[Callable[..., Node]]:
    nodes: list[Node] = []

    def make(*parameters: str) -> Node:
        nodes.append(Node(*parameters))
        return nodes[-1]

    yield make
    for node in nodes:
        node.process.terminate()
        try:
            node.process.wait(20)
        except subprocess.TimeoutExpired:
            node.kill()


@pytest.fixture
def robot() -> Iterator[Robot]:
    rclpy.init()
    made = Robot()
    yield made
    made.node.destroy_node()
    rclpy.try_shutdown()

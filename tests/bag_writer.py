"""Bags for tests, written by rosbags' own writers from the text files of a data set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.datasets import Sequence

Entry = tuple[int, str, str, Any]  # time in ns, topic, type, message


def nanoseconds(text: str) -> int:
    whole, _, rest = text.partition(".")
    return int(whole) * 10**9 + int(rest.ljust(9, "0")[:9] or 0)


class Messages:
    """Messages of one version of ROS."""

    def __init__(self, ros1: bool) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.types = self.store.types
        self.ros1 = ros1

    def make(self, name: str, **fields: Any) -> Any:
        return self.types[name](**fields)

    def header(self, stamp: int, frame: str) -> Any:
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **more)

    def image(self, stamp: int, pixels: np.ndarray, encoding: str | None = None, frame: str = "camera") -> Any:
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        encoding = encoding or {1: "mono", 3: "bgr", 4: "bgra"}[channels] + str(8 * pixels.itemsize)
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        return self.make(
            "sensor_msgs/msg/Image", header=self.header(stamp, frame), height=pixels.shape[0], width=pixels.shape[1],
            encoding=encoding, is_bigendian=0, step=pixels.shape[1] * channels * pixels.itemsize, data=data,
        )  # fmt: skip

    def compressed(self, stamp: int, pixels: np.ndarray, ending: str = ".png") -> Any:
        data = np.frombuffer(cv2.imencode(ending, pixels)[1].tobytes(), np.uint8)
        return self.make("sensor_msgs/msg/CompressedImage", header=self.header(stamp, "camera"), format=ending[1:], data=data)

    def pose(self, row: list[float]) -> Any:
        point = self.make("geometry_msgs/msg/Point", x=row[0], y=row[1], z=row[2])
        turn = self.make("geometry_msgs/msg/Quaternion", x=row[3], y=row[4], z=row[5], w=row[6])
        return self.make("geometry_msgs/msg/Pose", position=point, orientation=turn)

    def odometry(self, stamp: int, row: list[float]) -> Any:
        nothing = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=nothing, angular=nothing)
        zeros = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry", header=self.header(stamp, "odom"), child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(row), covariance=zeros),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros),
        )  # fmt: skip

    def truth(self, stamp: int, row: list[float]) -> Any:
        return self.make("geometry_msgs/msg/PoseStamped", header=self.header(stamp, "map"), pose=self.pose(row))

    def transform(self, stamp: int, parent: str, child: str, row: list[float]) -> Any:
        move = self.make("geometry_msgs/msg/Vector3", x=row[0], y=row[1], z=row[2])
        turn = self.make("geometry_msgs/msg/Quaternion", x=row[3], y=row[4], z=row[5], w=row[6])
        one = self.make(
            "geometry_msgs/msg/TransformStamped", header=self.header(stamp, parent), child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=move, rotation=turn),
        )  # fmt: skip
        return self.make("tf2_msgs/msg/TFMessage", transforms=[one])


def rows_of(path: Path) -> list[tuple[int, list[float]]]:
    lines = [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [(nanoseconds(fields[0]), [float(value) for value in fields[1:]]) for fields in lines]


def entries(drive: Sequence, ros: Messages, image: str = "raw", by_tf: bool = False) -> Iterator[Entry]:
    """Messages of a drive, in order of time."""
    found: list[Entry] = []
    frames = (drive.path / "frames.csv").read_text().splitlines()
    column = frames[0].split(",").index("timestamp")
    for line, file in zip(frames[1:], drive.files, strict=True):
        stamp, pixels = nanoseconds(line.split(",")[column]), read_image(file)
        if image == "raw":
            found.append((stamp, "/camera/image_raw", "sensor_msgs/msg/Image", ros.image(stamp, pixels)))
        else:
            message = ros.compressed(stamp, pixels, image)
            found.append((stamp, "/camera/image/compressed", "sensor_msgs/msg/CompressedImage", message))
    for stamp, row in rows_of(drive.path / "odometry.tum"):
        if by_tf:
            found.append((stamp, "/tf", "tf2_msgs/msg/TFMessage", ros.transform(stamp, "odom", "base_link", row)))
        else:
            found.append((stamp, "/odom", "nav_msgs/msg/Odometry", ros.odometry(stamp, row)))
    for stamp, row in rows_of(drive.path / "groundtruth.tum"):
        found.append((stamp, "/truth", "geometry_msgs/msg/PoseStamped", ros.truth(stamp, row)))
    return iter(sorted(found, key=lambda entry: entry[0]))


def write_ros1(path: Path, found: Iterator[Entry], ros: Messages, compression: str = "none") -> Path:
    writer = Writer1(path)
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        topics: dict[str, Any] = {}
        for stamp, topic, kind, message in found:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=ros.store)
            writer.write(topics[topic], stamp, ros.store.serialize_ros1(message, kind))
    return path


def write_ros2(path: Path, found: Iterator[Entry], ros: Messages, storage: str = "sqlite3", zstd: str | None = None) -> Path:
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if zstd is not None:
        writer.set_compression(CompressionMode[zstd.upper()], CompressionFormat.ZSTD)
    with writer:
        topics: dict[str, Any] = {}
        for stamp, topic, kind, message in found:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=ros.store)
            writer.write(topics[topic], stamp, ros.store.serialize_cdr(message, kind))
    return path

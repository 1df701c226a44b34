"""Bags of ROS 1 and ROS 2 and MCAP files, written message by message by the writers of ``rosbags`` and ``mcap`` (extra ``bags``)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.tools.datasets import Sequence, Trajectory
from panoloc_mcl.tools.datasets.recordings.ros.messages import COMPRESSED, IMAGE, ODOMETRY, POSE, TF

#: Time in nanoseconds, topic, type, message.
Entry = tuple[int, str, str, Any]


def nanoseconds(seconds: float) -> int:
    """The whole number that is nearest; divided by 1e9 it gives the same double again."""
    return round(Fraction(float(seconds)) * 10**9)


class Messages:
    """Messages of one version of ROS.

    Parameters
    ----------
    ros1 : bool
        Of ROS 1 (Noetic) and not of ROS 2 (Humble).
    """

    def __init__(self, ros1: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.types = self.store.types
        self.ros1 = ros1

    def make(self, name: str, **fields: Any) -> Any:
        """A message of a type."""
        return self.types[name](**fields)

    def raw(self, message: Any, kind: str) -> bytes:
        """Serialized."""
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        return bytes(serialize(message, kind))

    def header(self, stamp: int, frame: str) -> Any:
        """``std_msgs/Header``."""
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **more)

    def image(self, stamp: int, pixels: NDArray[Any], encoding: str | None = None, frame: str = "camera") -> Any:
        """``sensor_msgs/Image``."""
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        encoding = encoding or {1: "mono", 3: "bgr", 4: "bgra"}[channels] + str(8 * pixels.itemsize)
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        return self.make(
            IMAGE,
            header=self.header(stamp, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels.shape[1] * channels * pixels.itemsize,
            data=data,
        )

    def compressed(self, stamp: int, pixels: NDArray[Any], ending: str = ".png", frame: str = "camera") -> Any:
        """``sensor_msgs/CompressedImage``."""
        data = np.frombuffer(cv2.imencode(ending, pixels)[1].tobytes(), np.uint8)
        return self.make(COMPRESSED, header=self.header(stamp, frame), format=ending[1:], data=data)

    def pose(self, row: list[float]) -> Any:
        """``geometry_msgs/Pose`` from x, y, z and the quaternion."""
        point = self.make("geometry_msgs/msg/Point", x=row[0], y=row[1], z=row[2])
        turn = self.make("geometry_msgs/msg/Quaternion", x=row[3], y=row[4], z=row[5], w=row[6])
        return self.make("geometry_msgs/msg/Pose", position=point, orientation=turn)

    def odometry(self, stamp: int, row: list[float]) -> Any:
        """``nav_msgs/Odometry`` of ``base_link`` in ``odom``."""
        nothing = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=nothing, angular=nothing)
        zeros = np.zeros(36)
        return self.make(
            ODOMETRY,
            header=self.header(stamp, "odom"),
            child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(row), covariance=zeros),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros),
        )

    def truth(self, stamp: int, row: list[float]) -> Any:
        """``geometry_msgs/PoseStamped`` in ``map``."""
        return self.make(POSE, header=self.header(stamp, "map"), pose=self.pose(row))

    def transform(self, stamp: int, parent: str, child: str, row: list[float]) -> Any:
        """``tf2_msgs/TFMessage`` with one transform."""
        move = self.make("geometry_msgs/msg/Vector3", x=row[0], y=row[1], z=row[2])
        turn = self.make("geometry_msgs/msg/Quaternion", x=row[3], y=row[4], z=row[5], w=row[6])
        one = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=move, rotation=turn),
        )
        return self.make(TF, transforms=[one])


def rows_of(trajectory: Trajectory, file: Path) -> list[tuple[int, list[float]]]:
    """Stamps with x, y, z and the quaternion of a trajectory: as they stand in its TUM file, if there is one."""
    if file.is_file():
        lines = [line.split() for line in file.read_text().splitlines() if line.strip() and not line.startswith("#")]
        return [(nanoseconds(float(fields[0])), [float(value) for value in fields[1:]]) for fields in lines]
    quaternions = ((x, y, math.sin(0.5 * a), math.cos(0.5 * a)) for x, y, a in trajectory.poses.tolist())
    return [
        (nanoseconds(time), [x, y, 0.0, 0.0, 0.0, qz, qw])
        for time, (x, y, qz, qw) in zip(trajectory.times.tolist(), quaternions, strict=True)
    ]


def entries(drive: Sequence, ros: Messages, images: str = "raw", by_tf: bool = False) -> Iterator[Entry]:
    """Messages of a drive, in order of time; each image is read when its turn comes.

    Parameters
    ----------
    drive : Sequence
    ros : Messages
    images : str
        ``raw``, or what they are compressed as, such as ``.png``.
    by_tf : bool
        Odometry as the transform from ``odom`` to ``base_link``.
    """
    found: list[tuple[int, str, str, Callable[[], Any]]] = []
    for time, file in zip(drive.times.tolist(), drive.files, strict=True):
        stamp = nanoseconds(time)
        if images == "raw":
            found.append((stamp, "/camera/image_raw", IMAGE, partial(_image, ros.image, stamp, file)))
        else:
            compress = partial(ros.compressed, ending=images)
            found.append((stamp, "/camera/image/compressed", COMPRESSED, partial(_image, compress, stamp, file)))
    if drive.odometry is not None:
        for stamp, row in rows_of(drive.odometry, drive.path / "odometry.tum"):
            if by_tf:
                found.append((stamp, "/tf", TF, partial(ros.transform, stamp, "odom", "base_link", row)))
            else:
                found.append((stamp, "/odom", ODOMETRY, partial(ros.odometry, stamp, row)))
    if drive.groundtruth is not None:
        for stamp, row in rows_of(drive.groundtruth, drive.path / "groundtruth.tum"):
            found.append((stamp, "/truth", POSE, partial(ros.truth, stamp, row)))
    for stamp, topic, kind, make in sorted(found, key=lambda entry: entry[0]):
        yield stamp, topic, kind, make()


def _image(make: Callable[[int, NDArray[Any]], Any], stamp: int, file: ImageSource) -> Any:
    return make(stamp, read_image(file))


def write_ros1(drive: Sequence, path: Path, images: str = "raw", compression: str = "none") -> Path:
    """A ROS 1 bag, ``PATH.bag``."""
    ros = Messages(ros1=True)
    return save_ros1(path.with_name(f"{path.name}.bag"), entries(drive, ros, images), ros, compression)


def write_ros2(
    drive: Sequence, path: Path, images: str = "raw", storage: str = "sqlite3", zstd: str | None = None, by_tf: bool = False
) -> Path:
    """A ROS 2 bag, the folder ``PATH``."""
    ros = Messages(ros1=False)
    return save_ros2(path, entries(drive, ros, images, by_tf), ros, storage, zstd)


def write_mcap(drive: Sequence, path: Path, images: str = "raw", compression: str = "none") -> Path:
    """A plain MCAP file, ``PATH.mcap``."""
    ros = Messages(ros1=False)
    return save_mcap(path.with_name(f"{path.name}.mcap"), entries(drive, ros, images), ros, compression)


def save_ros1(path: Path, found: Iterable[Entry], ros: Messages, compression: str = "none", chunk: int = 1 << 20) -> Path:
    """Messages as a ROS 1 bag; ``compression``: none, bz2 or lz4; ``chunk``: bytes."""
    from rosbags.rosbag1 import Writer

    writer = Writer(path)
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        writer.chunk_threshold = chunk
        _write_all(writer, found, ros)
    return path


def save_ros2(path: Path, found: Iterable[Entry], ros: Messages, storage: str = "sqlite3", zstd: str | None = None) -> Path:
    """Messages as a ROS 2 bag; ``storage``: sqlite3 or mcap; ``zstd``: message or file."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if zstd is not None:
        writer.set_compression(CompressionMode[zstd.upper()], CompressionFormat.ZSTD)
    with writer:
        _write_all(writer, found, ros)
    return path


def _write_all(writer: Any, found: Iterable[Entry], ros: Messages) -> None:
    topics: dict[str, Any] = {}
    for stamp, topic, kind, message in found:
        if topic not in topics:
            topics[topic] = writer.add_connection(topic, kind, typestore=ros.store)
        writer.write(topics[topic], stamp, ros.raw(message, kind))


def save_mcap(path: Path, found: Iterable[Entry], ros: Messages, compression: str = "none", chunk: int = 1 << 20) -> Path:
    """Messages as an MCAP file; ``compression``: none, lz4 or zstd; ``chunk``: bytes."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk, compression=CompressionType[compression.upper()])
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for stamp, topic, kind, message in found:
            if topic not in channels:
                definition, _ = ros.store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(name=kind, encoding="ros2msg", data=definition.encode())
                channels[topic] = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
            writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, data=ros.raw(message, kind))
        writer.finish()
    return path

"""A recording of what a live robot saw: an MCAP file of ROS 2 messages, which `panoloc run` and ``ros2 bag play`` read.

Needs the extra ``bags``. Images are compressed without loss (PNG); messages are written as they come, so what was written before a
power cut can be read.
"""

from __future__ import annotations

import importlib.util
import math
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from panoloc_mcl.robot.errors import ImageError, OutputError
from panoloc_mcl.robot.interface.answers import TimedPose
from panoloc_mcl.robot.interface.messages import Image, Message, Odometry
from panoloc_mcl.tools.datasets.recordings.ros.messages import COMPRESSED, ODOMETRY, POSE_COVARIANCE
from panoloc_mcl.tools.live.engine import Answer

_TOPICS = {
    "/image/compressed": COMPRESSED,
    "/odom": ODOMETRY,
    "/panoloc/pose": POSE_COVARIANCE,
}


class McapRecorder:
    """Records messages and answers.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OutputError
        The file exists, cannot be written, or the extra is missing.
    """

    def __init__(self, path: Path) -> None:
        if importlib.util.find_spec("rosbags") is None or importlib.util.find_spec("mcap") is None:
            raise OutputError('output.record: needs rosbags and mcap; install them: pip install "panoloc-mcl[bags]"')
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore

        self._store = get_typestore(Stores.ROS2_HUMBLE)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("xb")
        except OSError as error:
            raise OutputError(f"output.record = {path}: cannot be written ({error.strerror}); choose another name") from error
        self._lock = threading.Lock()
        # Small chunks: of the last one little is lost.
        self._writer: Any = Writer(self._stream, chunk_size=1 << 18)
        self._writer.start(profile="ros2", library="panoloc")
        self._channels: dict[str, int] = {}
        for topic, kind in _TOPICS.items():
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            schema = self._writer.register_schema(name=kind, encoding="ros2msg", data=definition.encode())
            self._channels[topic] = self._writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)

    def take(self, message: Message) -> None:
        """Write an image or an odometry measurement as it came, from whichever thread."""
        t = self._store.types
        if isinstance(message, Odometry):
            pose, twist = np.zeros(36), np.zeros(36)
            if message.covariance is not None:
                pose = _six(message.covariance)
            velocity = np.zeros(3) if message.velocity is None else message.velocity
            speed = t["geometry_msgs/msg/Twist"](
                linear=self._vector(velocity[0], velocity[1], 0.0), angular=self._vector(0.0, 0.0, velocity[2])
            )
            made = t[ODOMETRY](
                header=self._header(message.timestamp, message.frame),
                child_frame_id="base_link",
                pose=t["geometry_msgs/msg/PoseWithCovariance"](pose=self._pose(message.pose), covariance=pose),
                twist=t["geometry_msgs/msg/TwistWithCovariance"](twist=speed, covariance=twist),
            )
            self._write("/odom", message.timestamp, made)
        elif isinstance(message, Image):
            pixels = message.pixels()
            if isinstance(pixels, ImageError) or not pixels.size:
                return
            data = np.frombuffer(cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes(), dtype=np.uint8)
            header = self._header(message.timestamp, message.frame)
            made = t[COMPRESSED](header=header, format="png", data=data)
            self._write("/image/compressed", message.timestamp, made)

    def answered(self, answer: Answer) -> None:
        """Write the pose."""
        t, estimate = self._store.types, answer.estimate
        inner = t["geometry_msgs/msg/PoseWithCovariance"](pose=self._pose(estimate.pose), covariance=_six(estimate.covariance))
        header = self._header(answer.image.timestamp, "map")
        self._write("/panoloc/pose", answer.image.timestamp, t[POSE_COVARIANCE](header=header, pose=inner))

    def moved(self, robot: TimedPose, odometry: TimedPose) -> None:
        """It can be computed from the others."""

    def close(self) -> None:
        """Write the index."""
        with self._lock:
            if not self._stream.closed:
                self._writer.finish()
                self._stream.close()

    def _write(self, topic: str, timestamp: float, message: Any) -> None:
        raw = bytes(self._store.serialize_cdr(message, _TOPICS[topic]))
        stamp = max(round(timestamp * 1e9), 0)
        with self._lock:
            if not self._stream.closed:
                self._writer.add_message(self._channels[topic], log_time=stamp, publish_time=stamp, data=raw)

    def _header(self, timestamp: float, frame: str) -> Any:
        nanoseconds = max(round(timestamp * 1e9), 0)
        time = self._store.types["builtin_interfaces/msg/Time"](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        return self._store.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._store.types["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=float(z))

    def _pose(self, pose: Any) -> Any:
        t, heading = self._store.types, float(pose[2])
        point = t["geometry_msgs/msg/Point"](x=float(pose[0]), y=float(pose[1]), z=0.0)
        turn = t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))
        return t["geometry_msgs/msg/Pose"](position=point, orientation=turn)


def _six(covariance: Any) -> Any:
    """Of x, y and heading as ROS has it: 6 x 6, row by row."""
    whole, rows = np.zeros((6, 6)), [0, 1, 5]
    whole[np.ix_(rows, rows)] = covariance
    return whole.reshape(-1)

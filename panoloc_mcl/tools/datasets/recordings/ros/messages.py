"""What ROS messages say: pixels, poses in the plane, stamps."""

from __future__ import annotations

import math
from operator import attrgetter
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.images import Image

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
ODOMETRY, POSE, POSE_COVARIANCE = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
TF, CAMERA_INFO = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/CameraInfo"

# What is looked at of messages that are not read at once.
_FIELDS = {
    IMAGE: ("header.frame_id", "height", "width", "step", "encoding", "is_bigendian", "data"),
    COMPRESSED: ("header.frame_id", "format", "data"),
    CAMERA_INFO: ("height", "width", "distortion_model"),
}

_CHANNELS = {
    "mono": 1,
    "rgb": 3,
    "bgr": 3,
    "rgba": 4,
    "bgra": 4,
    "bayer_rggb": 1,
    "bayer_bggr": 1,
    "bayer_gbrg": 1,
    "bayer_grbg": 1,
}
_TO_BGR = {
    "rgb": cv2.COLOR_RGB2BGR,
    "rgba": cv2.COLOR_RGBA2BGRA,
    # OpenCV names the patterns by their second row and column, ROS by the first.
    "bayer_rggb": cv2.COLOR_BayerBG2BGR,
    "bayer_bggr": cv2.COLOR_BayerRG2BGR,
    "bayer_gbrg": cv2.COLOR_BayerGR2BGR,
    "bayer_grbg": cv2.COLOR_BayerGB2BGR,
}
_YUV = {
    "yuv422": cv2.COLOR_YUV2BGR_UYVY,
    "uyvy": cv2.COLOR_YUV2BGR_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUY2,
    "yuyv": cv2.COLOR_YUV2BGR_YUY2,
}


def stamp_ns(message: Any) -> int:
    """Stamp of a message's header, nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def seconds_of(nanoseconds: int) -> float:
    """The double that is nearest: the same as that of the decimal number in a text file."""
    return nanoseconds / 10**9


def pixels_of(message: Any, where: str) -> Image:
    """Pixels of an ``Image`` or a ``CompressedImage``: grey, or colour in OpenCV's order, 8 or 16 bits.

    Raises
    ------
    ImageError
        An unknown encoding, or data that are not what the message says.
    """
    if hasattr(message, "format"):
        return _decoded(np.frombuffer(bytes(message.data), dtype=np.uint8), where)
    encoding = message.encoding.lower()
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(bytes(message.data), dtype=np.uint8)
    if encoding in _YUV:
        raw = _rows(data, height, width, step, 2, np.dtype(np.uint8), encoding, where)
        return np.asarray(cv2.cvtColor(raw, _YUV[encoding]))
    kind, bits = _kind_of(encoding, where)
    dtype = np.dtype(np.uint8) if bits == 8 else np.dtype(">u2" if message.is_bigendian else "<u2")
    rows = _rows(data, height, width, step, _CHANNELS[kind], dtype, encoding, where).astype(dtype.newbyteorder("="), copy=False)
    if kind in _TO_BGR:
        rows = np.asarray(cv2.cvtColor(np.ascontiguousarray(rows), _TO_BGR[kind]))
    return np.ascontiguousarray(rows)


def _kind_of(encoding: str, where: str) -> tuple[str, int]:
    for channels, kind in ((1, "mono"), (3, "bgr"), (4, "bgra")):
        for bits in (8, 16):
            if encoding in (f"{bits}uc{channels}", f"{kind}{bits}"):
                return kind, bits
    for kind in _CHANNELS:
        if encoding in (f"{kind}8", f"{kind}16"):
            return kind, int(encoding.removeprefix(kind))
    raise ImageError(f"{where}: encoding '{encoding}' is unknown; record mono8, bgr8, rgb8, a bayer pattern, or their 16 bits")


def _rows(
    data: NDArray[np.uint8], height: int, width: int, step: int, channels: int, dtype: np.dtype[Any], encoding: str, where: str
) -> NDArray[Any]:
    line = width * channels * dtype.itemsize
    step = step or line
    if height < 1 or width < 1 or step < line or len(data) < step * (height - 1) + line:
        raise ImageError(
            f"{where}: {len(data)} bytes are no {width} x {height} pixels of '{encoding}' in rows of {step} bytes; mend the driver"
        )
    if len(data) < step * height:
        data = np.concatenate([data, np.zeros(step * height - len(data), np.uint8)])
    lines = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :line]).view(dtype)
    return lines if channels == 1 else lines.reshape(height, width, channels)


def _decoded(data: NDArray[np.uint8], where: str) -> Image:
    # What the message calls its format is often not what it is.
    image = None
    if len(data):
        try:
            image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        except cv2.error:
            image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"{where}: {len(data)} bytes are no JPEG or PNG; record the raw images, or mend the driver")
    return np.asarray(image)


def planar(position: Any, rotation: Any) -> tuple[float, ...] | None:
    """x, y and the quaternion of a pose, if they are finite and the quaternion is one."""
    values = (position.x, position.y, rotation.x, rotation.y, rotation.z, rotation.w)
    floats = tuple(float(value) for value in values)
    norm = math.hypot(*floats[2:])
    if not all(math.isfinite(value) for value in floats) or not 0.5 < norm < 2.0:
        return None
    return floats


def pose_of(message: Any) -> tuple[float, ...] | None:
    """`planar` of an ``Odometry``, a ``PoseStamped`` or a ``PoseWithCovarianceStamped``."""
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return planar(pose.position, pose.orientation)


class Transform(NamedTuple):
    """Where a frame is in its parent: `planar` of it, the height in metres, and the stamp."""

    child: str
    parent: str
    stamp_ns: int
    pose: tuple[float, ...] | None
    z_m: float


def transforms_of(message: Any) -> list[Transform]:
    """Those of a ``TFMessage``."""
    return [
        Transform(
            one.child_frame_id.lstrip("/"),
            one.header.frame_id.lstrip("/"),
            stamp_ns(one),
            planar(one.transform.translation, one.transform.rotation),
            float(one.transform.translation.z),
        )
        for one in message.transforms
    ]


def either(message: Any, name: str) -> Any:
    """A field of a ``CameraInfo`` that is written in capitals in ROS 1."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())


def read_through(message: Any, kind: str) -> None:
    """Look at all that is read of a message; raises AttributeError where it lacks a field."""
    if kind == TF:
        transforms_of(message)
    elif kind in (ODOMETRY, POSE, POSE_COVARIANCE):
        stamp_ns(message)
        pose_of(message)
    elif kind in (IMAGE, COMPRESSED):
        stamp_ns(message)
    elif kind == CAMERA_INFO:
        for name in "dk":
            either(message, name)
    for field in _FIELDS.get(kind, ()):
        attrgetter(field)(message)

"""Map, particles, pose, panorama and status over Foxglove's WebSocket. Needs the extra ``live``."""

from __future__ import annotations

import importlib.util
import math
from typing import Any

import cv2
import numpy as np

from panoloc_mcl.robot.errors import ImageError, OutputError
from panoloc_mcl.robot.floors import AnyLocalizer
from panoloc_mcl.robot.interface.answers import TimedPose
from panoloc_mcl.tools.live.engine import Answer

# Particles that are shown.
_SHOWN = 500


class FoxgloveServer:
    """Serves what Foxglove's app shows; one server a process.

    Topics: ``/tf`` (map, odom, base_link), ``/pose``, ``/particles``, ``/map`` (places of the references), ``/panorama`` and
    ``/status``.

    Parameters
    ----------
    localizer : Localizer or FloorLocalizer
    host : str
    port : int
        0 takes a free one.

    Raises
    ------
    OutputError
        The port is in use, or the extra is missing.
    """

    def __init__(self, localizer: AnyLocalizer, host: str = "127.0.0.1", port: int = 8765) -> None:
        if importlib.util.find_spec("foxglove") is None:
            raise OutputError('output.foxglove: needs the Foxglove SDK; install it: pip install "panoloc-mcl[live]"')
        import foxglove
        from foxglove import channels

        self._localizer = localizer
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(name="panoloc", host=host, port=port, context=self._context)
        except Exception as error:
            raise OutputError(f"output.foxglove.port = {port}: cannot be served on ({error}); choose another port") from error
        self.port = int(self._server.port)
        own: dict[str, Any] = {"context": self._context}
        self._tf = channels.FrameTransformsChannel("/tf", **own)
        self._pose = channels.PoseInFrameChannel("/pose", **own)
        self._particles = channels.PosesInFrameChannel("/particles", **own)
        self._map = channels.PosesInFrameChannel("/map", **own)
        self._image = channels.CompressedImageChannel("/panorama", **own)
        schema = {"type": "object", "properties": {"status": {"type": "string"}, "latency_ms": {"type": "number"}}}
        self._status = foxglove.Channel("/status", schema=schema, **own)
        self._map_at = -math.inf

    def answered(self, answer: Answer) -> None:
        """Everything but the frames."""
        from foxglove import messages as m

        estimate, stamp = answer.estimate, _timestamp(answer.image.timestamp)
        self._pose.log(m.PoseInFrame(timestamp=stamp, frame_id="map", pose=_pose(estimate.pose)))
        poses, weights = self._localizer.particles
        chosen: Any = np.linspace(0, len(poses) - 1, min(len(poses), _SHOWN)).astype(int) if len(weights) else []
        shown = [_pose(poses[index]) for index in chosen]
        self._particles.log(m.PosesInFrame(timestamp=stamp, frame_id="map", poses=shown))
        if abs(answer.image.timestamp - self._map_at) > 5.0:
            self._map_at = answer.image.timestamp
            places = self._localizer.places.positions
            kept = [_pose(np.array([x, y, 0.0])) for x, y in places[:: max(1, len(places) // 2000)].tolist()]
            self._map.log(m.PosesInFrame(timestamp=stamp, frame_id="map", poses=kept))
        if not isinstance(answer.pixels, ImageError) and answer.pixels.size:
            eight = answer.pixels if answer.pixels.dtype == np.uint8 else (answer.pixels >> 8).astype(np.uint8)
            data = cv2.imencode(".jpg", eight)[1].tobytes()
            self._image.log(m.CompressedImage(timestamp=stamp, frame_id="camera", data=data, format="jpeg"))
        self._status.log(
            {
                "timestamp": answer.image.timestamp,
                "status": estimate.status.value,
                "message": estimate.message,
                "latency_ms": answer.latency_ms,
                "dropped": answer.dropped,
            }
        )

    def moved(self, robot: TimedPose, odometry: TimedPose) -> None:
        """The frames: ``map`` to ``odom``, and ``odom`` to ``base_link``."""
        from foxglove import messages as m

        driven = self._localizer.driven(robot.timestamp)
        stamp = _timestamp(robot.timestamp)
        frames = [("map", "odom", odometry.pose)] + ([("odom", "base_link", driven)] if driven is not None else [])
        transforms = [
            m.FrameTransform(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=m.Vector3(x=float(pose[0]), y=float(pose[1]), z=0.0),
                rotation=_rotation(float(pose[2])),
            )
            for parent, child, pose in frames
        ]
        self._tf.log(m.FrameTransforms(transforms=transforms))

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()


def _timestamp(seconds: float) -> Any:
    from foxglove import messages as m

    whole = math.floor(seconds)
    return m.Timestamp(sec=max(int(whole), 0), nsec=min(int((seconds - whole) * 1e9), 10**9 - 1))


def _rotation(heading: float) -> Any:
    from foxglove import messages as m

    return m.Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))


def _pose(pose: Any) -> Any:
    from foxglove import messages as m

    return m.Pose(position=m.Vector3(x=float(pose[0]), y=float(pose[1]), z=0.0), orientation=_rotation(float(pose[2])))

"""Poses as JSON, one object a line: for any program that reads a pipe."""

from __future__ import annotations

import json
import math
import threading
from typing import Any, TextIO

from panoloc_mcl.robot.interface.answers import TimedPose
from panoloc_mcl.tools.live.engine import Answer


class JsonLines:
    """Writes a line an answer, and one a movement if that is wanted.

    Parameters
    ----------
    stream : text stream
    movements : bool
        Also the pose at every odometry measurement.
    """

    def __init__(self, stream: TextIO, movements: bool = False) -> None:
        self._stream, self._movements = stream, movements
        self._lock = threading.Lock()

    def answered(self, answer: Answer) -> None:
        """``kind: answer``: pose, covariance, status, reasons, latency."""
        estimate = answer.estimate
        self._write(
            {
                "kind": "answer",
                "timestamp": answer.image.timestamp,
                "map": estimate.map,
                "pose": [float(value) for value in estimate.pose],
                "covariance": [[float(value) for value in row] for row in estimate.covariance],
                "status": estimate.status.value,
                "reasons": [reason.value for reason in estimate.reasons],
                "message": estimate.message,
                "latency_ms": round(answer.latency_ms, 3),
                "dropped": answer.dropped,
            }
        )

    def moved(self, robot: TimedPose, odometry: TimedPose) -> None:
        """``kind: pose``: where odometry leads from the last answer."""
        if self._movements:
            line = {"kind": "pose", "timestamp": robot.timestamp, "pose": robot.pose.tolist(), "status": robot.status.value}
            self._write({**line, "covariance": robot.covariance.tolist(), "answered": robot.answered})

    def close(self) -> None:
        """The stream is not ours to close."""
        self._stream.flush()

    def _write(self, values: dict[str, Any]) -> None:
        values = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in values.items()
        }
        with self._lock:
            self._stream.write(json.dumps(values) + "\n")
            self._stream.flush()

"""Poses as a recording has them: in any order, doubled, with stamps of nothing."""

from __future__ import annotations

import numpy as np

from panoloc_mcl.robot.geometry import yaw_from_quaternion
from panoloc_mcl.tools.datasets.recordings.ros.messages import seconds_of
from panoloc_mcl.tools.datasets.trajectory import Trajectory


class Track:
    """Collects poses with their stamps."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._rows: list[tuple[float, ...]] = []
        self.left_out = 0

    def add(self, stamp_ns: int, pose: tuple[float, ...] | None) -> None:
        """A stamp in nanoseconds, and x, y, qx, qy, qz, qw; None is counted and left out."""
        if pose is None:
            self.left_out += 1
            return
        self._stamps.append(stamp_ns)
        self._rows.append(pose)

    def trajectory(self) -> Trajectory | None:
        """In order of time, the first of those with one stamp; None if there are none."""
        if not self._stamps:
            return None
        stamps, first = np.unique(np.array(self._stamps, dtype=np.int64), return_index=True)
        self.left_out += len(self._stamps) - len(stamps)
        rows = np.array(self._rows, dtype=np.float64)[first]
        norm = np.linalg.norm(rows[:, 2:], axis=1, keepdims=True)
        yaw = yaw_from_quaternion(*(rows[:, 2:] / norm).T)
        return Trajectory(np.array([seconds_of(int(stamp)) for stamp in stamps]), np.column_stack([rows[:, :2], yaw]))

"""The tree of frames that a recording carries (``/tf``, ``/tf_static``): where one frame was in another over time."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.camera.mount import OPTICAL, Mount, angles_deg
from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.tools.datasets.recordings.ros.messages import transforms_of
from panoloc_mcl.tools.datasets.recordings.ros.tracks import Track
from panoloc_mcl.tools.datasets.trajectory import Trajectory

_SPELLINGS = {"base_link": ("base_link", "base_footprint")}


class Transforms:
    """Collected transforms; each frame has one parent."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = defaultdict(Track)
        self._parents: dict[str, str] = {}
        # The last one of each frame: where it is in its parent, and from its axes to the parent's.
        self._last: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def add(self, message: Any) -> None:
        """Take a ``TFMessage``."""
        for child, parent, stamp, pose, z in transforms_of(message):
            if pose is not None:
                self._parents[child] = parent
                self._tracks[child].add(stamp, pose)
                self._last[child] = np.array([*pose[:2], z]), Rotation.from_quat(pose[2:]).as_matrix()

    def between(self, parent: str, child: str) -> Trajectory | None:
        """Poses of a frame in another, in the plane; None if they are not connected. A fixed one is a single pose."""
        chain = self._chain(parent, child)
        return None if chain is None else self._along(chain)

    def placed(self, parent: str, child: str) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Where a frame is in another by the last transforms.

        Returns
        -------
        (float64 (3,), float64 (3, 3)) or None
            Position, metres, and from the frame's axes to those of the other; None if they are not connected.
        """
        spelled = next((chain for name in _SPELLINGS.get(parent, (parent,)) if (chain := self._chain(name, child))), None)
        if spelled is None:
            return None
        position, axes = np.zeros(3), np.eye(3)
        for frame in spelled[:-1]:
            moved, turned = self._last[frame]
            position, axes = moved + turned @ position, turned @ axes
        return position, axes

    def _chain(self, parent: str, child: str) -> list[str] | None:
        for spelling in _SPELLINGS.get(child, (child,)):
            chain = [spelling]
            while chain[-1] != parent and chain[-1] in self._parents and len(chain) < 100:
                chain.append(self._parents[chain[-1]])
            if chain[-1] == parent and len(chain) > 1:
                return chain
        return None

    def _along(self, chain: list[str]) -> Trajectory | None:
        steps = [self._tracks[frame].trajectory() for frame in chain[:-1]]
        known = [step for step in steps if step is not None]
        if len(known) < len(steps):
            return None
        # At the times of the transform that comes most often, within those that come at all.
        times = max(known, key=len).times
        moving = [step for step in known if len(step) > 1]
        if moving:
            begin, end = max(step.times[0] for step in moving), min(step.times[-1] for step in moving)
            times = times[(times >= begin) & (times <= end)]
        if not len(times):
            return None
        pose = np.zeros((len(times), 3))
        for step in reversed(known):
            pose = compose(pose, step.at(times))
        return Trajectory(times, pose)


def mount_of(position: NDArray[np.float64], axes: NDArray[np.float64], frame: str) -> Mount:
    """A camera's mount from where its frame is in the base's.

    Parameters
    ----------
    position : float64 (3,)
        Metres.
    axes : float64 (3, 3)
        From the frame's axes to the base's.
    frame : str
        Its name: one with ``optical`` in it has the axes of an image (x right, y down, z ahead).
    """
    body = axes @ OPTICAL.T if "optical" in frame.lower() else axes
    yaw, pitch, roll = angles_deg(body)
    return Mount(x_m=float(position[0]), y_m=float(position[1]), yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll, far=True)

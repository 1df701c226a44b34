"""The tree of frames that a recording carries (``/tf``): where one frame was in another over time."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.tools.datasets.recordings.ros_messages import planar, stamp_ns
from panoloc_mcl.tools.datasets.recordings.tracks import Track
from panoloc_mcl.tools.datasets.trajectory import Trajectory

_SPELLINGS = {"base_link": ("base_link", "base_footprint")}


class Transforms:
    """Collected transforms; each frame has one parent."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = defaultdict(Track)
        self._parents: dict[str, str] = {}

    def add(self, message: Any) -> None:
        """Take a ``TFMessage``."""
        for transform in message.transforms:
            child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
            pose = planar(transform.transform.translation, transform.transform.rotation)
            if pose is not None:
                self._parents[child] = parent
                self._tracks[child].add(stamp_ns(transform), pose)

    def between(self, parent: str, child: str) -> Trajectory | None:
        """Poses of a frame in another, in the plane; None if they are not connected. A fixed one is a single pose."""
        for spelling in _SPELLINGS.get(child, (child,)):
            chain = [spelling]
            while chain[-1] != parent and chain[-1] in self._parents and len(chain) < 100:
                chain.append(self._parents[chain[-1]])
            if chain[-1] == parent and len(chain) > 1:
                return self._along(chain)
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

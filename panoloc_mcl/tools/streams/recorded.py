"""The messages of a recorded drive, in the order that a robot would have got them in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.robot.interface.messages import Image, Message, Odometry, Truth
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import Trajectory


def recorded(
    drive: Drive,
    arrival: NDArray[np.float64] | None = None,
    kept: NDArray[np.bool_] | None = None,
    read: Callable[[ImageSource], NDArray[Any]] = read_image,
) -> Iterator[Message]:
    """Messages of a drive; one image after the other is read, when somebody looks at it.

    An image takes longer to arrive than an odometry measurement: it comes after the first measurement that is not older, so that the
    motion up to it is known and not extrapolated.

    Parameters
    ----------
    drive : Sequence
    arrival : float64 (n,), optional
        When each image arrives, seconds; when it was taken if left out.
    kept : bool (n,), optional
        Which images arrive at all.
    read : callable, optional
        Gives the pixels of one of the drive's files.
    """
    arrival = drive.times if arrival is None else arrival
    odometry = _Track(drive.odometry, Odometry)
    truth = _Track(drive.groundtruth, Truth)
    for index in np.argsort(arrival, kind="stable").tolist():
        if kept is not None and not kept[index]:
            continue
        yield from odometry.until(float(arrival[index]))
        yield from truth.until(float(arrival[index]))
        yield Image(float(drive.times[index]), partial(read, drive.files[index]), index)


class _Track:
    """A trajectory as messages, handed out bit by bit."""

    def __init__(self, trajectory: Trajectory | None, kind: type[Odometry] | type[Truth]) -> None:
        self._trajectory, self._kind, self._next = trajectory, kind, 0

    def until(self, time: float) -> Iterator[Odometry | Truth]:
        """Those up to a time that were not handed out yet, and the first one that is not older than it."""
        if self._trajectory is None:
            return
        times, poses = self._trajectory.times, self._trajectory.poses
        while self._next < len(times) and (self._next == 0 or times[self._next - 1] < time):
            yield self._kind(float(times[self._next]), poses[self._next])
            self._next += 1

"""What comes to a localizer, be it from a recording or from a running robot: one message at a time, each with its own stamp."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ImageError

Float64 = NDArray[np.float64]
Pixels = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Odometry:
    """Where odometry has the robot.

    Parameters
    ----------
    timestamp : float
        Seconds.
    pose : float64 (3,)
        x, y, heading in the odometry frame, metres and radians.
    velocity : float64 (3,), optional
        Forward and leftward, m/s, and turning, rad/s, in the robot's frame. Carries the pose on beyond the newest measurement.
    covariance : float64 (3, 3), optional
        Of ``pose``, as far as odometry itself counts it up: what it grows by between two images is noise of the way between them.
    frame : str
        Name of the frame that the pose is in.
    """

    timestamp: float
    pose: Float64
    velocity: Float64 | None = None
    covariance: Float64 | None = None
    frame: str = "odom"


@dataclass(frozen=True, eq=False)
class Image:
    """An image, read only when somebody looks at it.

    Parameters
    ----------
    timestamp : float
        When it was taken, seconds.
    source : ndarray, or a callable that gives one
        Grey, or colour in OpenCV's order; 8 or 16 bits. The callable raises `ImageError` if there is no such image.
    index : int
        Its number in the recording; -1 for one that comes from no recording.
    frame : str
        Name of the camera's frame.
    """

    timestamp: float
    source: Pixels | Callable[[], Pixels]
    index: int = -1
    frame: str = "camera"

    def pixels(self) -> Pixels | ImageError:
        """The image, or why it cannot be read: then it is a bad image like any other, skipped and counted."""
        if not callable(self.source):
            return self.source
        try:
            return self.source()
        except ImageError as error:
            return error


@dataclass(frozen=True, eq=False)
class Truth:
    """Where the robot was: no localizer gets it, it is there to be compared with.

    Parameters
    ----------
    timestamp : float
        Seconds.
    pose : float64 (3,)
        x, y, heading in the map frame, metres and radians.
    frame : str
        Name of the frame that the pose is in.
    """

    timestamp: float
    pose: Float64
    frame: str = "map"


Message = Odometry | Image | Truth

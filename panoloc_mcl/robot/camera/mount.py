"""Where a camera sits on the robot, and how it is turned."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.settings.validation import StrictModel

Float64 = NDArray[np.float64]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]

_FAR_M = 1.0

#: From the axes of an image (x right, y down, z ahead) to those of a body (x ahead, y left, z up).
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def rotation(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Float64:
    """From the axes of something mounted to those it is mounted on: ``Rz(yaw) Ry(pitch) Rx(roll)``, float64 (3, 3).

    Axes as in ROS REP 103 (x forward, y left, z up): yaw turns left, pitch the nose down, roll the right side down.
    """
    (cy, cp, cr), (sy, sp, sr) = ([f(math.radians(a)) for a in (yaw_deg, pitch_deg, roll_deg)] for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def angles_deg(turned: Float64) -> tuple[float, float, float]:
    """Yaw, pitch and roll, degrees, that `rotation` makes a float64 (3, 3) of."""
    pitch = math.asin(min(max(-float(turned[2, 0]), -1.0), 1.0))
    yaw, roll = math.atan2(turned[1, 0], turned[0, 0]), math.atan2(turned[2, 1], turned[2, 2])
    # Zero is zero, and not what rounding leaves of it.
    return tuple(round(math.degrees(angle), 9) + 0.0 for angle in (yaw, pitch, roll))  # type: ignore[return-value]


class Mount(StrictModel):
    """Where the camera sits on the robot's base, and how it is turned.

    ``x_m`` forward and ``y_m`` to the left of the point that the robot's poses are of; ``yaw_deg`` counter-clockwise, ``pitch_deg``
    nose down, ``roll_deg`` right side down (180: hangs upside down). Farther than a metre is taken for a slip of the unit,
    unless ``far`` says that it is meant.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    roll_deg: Angle = 0.0
    far: bool = False

    @model_validator(mode="after")
    def _near_the_base(self) -> Mount:
        for name, value in (("x_m", self.x_m), ("y_m", self.y_m)):
            if abs(value) > _FAR_M and not self.far:
                raise ValueError(
                    f"{name} = {value:g} is more than a metre off the base; check the unit (metres), or add far: true"
                )
        return self

    @property
    def yaw(self) -> float:
        """Radians."""
        return math.radians(self.yaw_deg)

    @property
    def offset(self) -> Float64:
        """The camera's position as a pose in the base's frame, with the base's heading: float64 (3,)."""
        return np.array([self.x_m, self.y_m, 0.0])

    @property
    def is_upright(self) -> bool:
        """Neither pitch nor roll."""
        return self.pitch_deg == self.roll_deg == 0.0

    def camera_poses(self, base: ArrayLike) -> Float64:
        """Where the camera is, upright and looking as the base does, when the base is at poses (..., 3)."""
        return compose(base, self.offset) if self.offset.any() else np.asarray(base, dtype=np.float64)

    def base_poses(self, camera: ArrayLike) -> Float64:
        """Where the base is; undoes `camera_poses`."""
        return compose(camera, -self.offset) if self.offset.any() else np.asarray(camera, dtype=np.float64)

    def camera_velocity(self, base: ArrayLike) -> Float64:
        """How the camera moves, forward, leftward and turning, float64 (3,), when the base moves so: it swings around the base."""
        forward, leftward, turning = np.asarray(base, dtype=np.float64)
        return np.array([forward - turning * self.y_m, leftward + turning * self.x_m, turning])

    @property
    def rotation(self) -> Float64:
        """From the camera's axes to the base's, float64 (3, 3)."""
        return rotation(self.yaw_deg, self.pitch_deg, self.roll_deg)

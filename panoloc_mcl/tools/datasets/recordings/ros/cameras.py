"""What a bag says of its camera: ``CameraInfo`` of fisheyes, and where tf has the camera on the robot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from panoloc_mcl.robot.camera.mount import Mount, angles_deg
from panoloc_mcl.robot.camera.spec import AnyCamera, camera_from_mapping
from panoloc_mcl.robot.errors import CameraError
from panoloc_mcl.tools.datasets.recordings.ros.messages import either
from panoloc_mcl.tools.datasets.recordings.ros.transforms import Transforms, mount_of

# Cosine of the tilt from the vertical up to which a fisheye makes panoramas.
_VERTICAL = math.cos(math.radians(30.0))


def camera_of_info(message: Any, frame: str, tree: Transforms, base: str, where: str) -> tuple[AnyCamera | None, str]:
    """The camera that a ``sensor_msgs/CameraInfo`` describes, if it is a fisheye with a vertical axis, and a note.

    Parameters
    ----------
    message : CameraInfo
        ``distortion_model`` equidistant or fisheye, or else it describes no camera of panoramas.
    frame : str
        Of the images.
    tree : Transforms
        May say where the axis points and where the robot's heading is in the image; without it the camera is taken to look down,
        the heading up in the image.
    base : str
        The robot's frame.
    where : str
        The topic, for notes.
    """
    if message.distortion_model not in ("equidistant", "fisheye"):
        return None, ""
    matrix, distortion = ([float(value) for value in either(message, name)] for name in ("k", "d"))
    lens = {"kind": "kannala_brandt", "fx": matrix[0], "fy": matrix[4], "cx": matrix[2], "cy": matrix[5], "k": distortion}
    data: dict[str, Any] = {"kind": "omni", "lens": lens, "size_px": [int(message.width), int(message.height)]}
    placed, note = tree.placed(base, frame), ""
    if placed is None:
        note = f"the camera is that of {where}, taken to look down; if it does not, put a camera.yaml beside the recording"
    else:
        position, axes = placed
        up = float(axes[2, 2])
        if abs(up) < _VERTICAL:
            return None, f"{where}: its axis is not vertical (tf: {base} to {frame}), so it makes no panorama by itself"
        ahead = axes.T[:, 0]
        data |= {"looks": "up" if up > 0.0 else "down", "heading_angle_deg": math.degrees(math.atan2(-ahead[1], ahead[0]))}
        tilt = angles_deg(axes @ _upright(data["looks"], data["heading_angle_deg"]).T)
        data["mount"] = {
            **{"x_m": float(position[0]), "y_m": float(position[1]), "far": True},
            **dict(zip(("yaw_deg", "pitch_deg", "roll_deg"), tilt, strict=True)),
        }
        note = f"the camera is that of {where}, looks {data['looks']} by tf"
    try:
        return camera_from_mapping(data, where), note
    except CameraError as error:
        return None, f"{'; '.join(error.faults)}; not used"


def _upright(looks: str, heading_angle_deg: float) -> Any:
    """From the image's axes to the base's if the axis were exactly vertical: float64 (3, 3)."""
    angle = math.radians(heading_angle_deg)
    ahead = np.array([math.cos(angle), -math.sin(angle), 0.0])
    axis = np.array([0.0, 0.0, 1.0])
    zenith = axis if looks == "up" else -axis
    return np.stack([ahead, np.cross(zenith, ahead), zenith])


def mount_by(tree: Transforms, base: str, frame: str) -> Mount | None:
    """Where tf has the camera; None if it says nothing, or that the camera is the base itself."""
    placed = tree.placed(base, frame)
    if placed is None:
        return None
    mount = mount_of(*placed, frame)
    return None if mount == Mount(far=True) else mount

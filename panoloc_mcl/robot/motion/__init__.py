"""Odometry: a buffer that answers for any time, and the noise of the way between two times; and which times images may have."""

from panoloc_mcl.robot.motion.image_clock import ImageClock
from panoloc_mcl.robot.motion.measured import is_possible, planar_pose, seconds
from panoloc_mcl.robot.motion.models import Motion, blind, carried
from panoloc_mcl.robot.motion.odometry import OdometryBuffer
from panoloc_mcl.robot.motion.reckoning import Anchor, carried_to

__all__ = [
    "Anchor",
    "ImageClock",
    "Motion",
    "OdometryBuffer",
    "blind",
    "carried",
    "carried_to",
    "is_possible",
    "planar_pose",
    "seconds",
]

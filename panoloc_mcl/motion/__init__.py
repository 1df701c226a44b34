"""Odometry: a buffer that answers for any time, and the noise of the way between two times."""

from panoloc_mcl.motion.models import Motion, blind, carried
from panoloc_mcl.motion.odometry import OdometryBuffer

__all__ = ["Motion", "OdometryBuffer", "blind", "carried"]

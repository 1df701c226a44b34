"""Why an answer rests on less than it should: the kinds of trouble that a localizer tells its caller, each with what to do about it."""

from __future__ import annotations

from enum import StrEnum
from typing import Self


class Reason(StrEnum):
    """What befell a localizer since its last answer.

    IMAGE_UNUSABLE: cannot be decoded, or is of another size or type than the camera delivers. IMAGE_BLANK: black, saturated,
    masked or without texture. IMAGE_FROZEN: the same as before although odometry has moved on. FITS_NOWHERE: shows nothing of the
    map. STAMP_INVALID, STAMP_UNIT, STAMP_TWICE, STAMP_LATE, STAMP_AHEAD: an image was left out for its time stamp. CLOCK_JUMPED,
    CLOCK_SET_BACK, STREAM_LOOPED: time began anew. ODOMETRY_LEFT_OUT: some odometry could not be used. NOTHING_COUNTED: no image
    has spoken for the pose for too long. POSE_OUTDATED: odometry has left the pose of the last image that was taken in.
    MAP_CANNOT_TELL: the map alone cannot tell this pose from others. FASTER_THAN_BELIEVED: without odometry, images put the robot
    farther on than it can have driven. CAMERA_CONTRADICTED: floor and walls of many images contradict each other about the pose,
    more than in those of the map, so less is claimed from here on.
    """

    IMAGE_UNUSABLE = "image_unusable"
    IMAGE_BLANK = "image_blank"
    IMAGE_FROZEN = "image_frozen"
    FITS_NOWHERE = "fits_nowhere"
    STAMP_INVALID = "stamp_invalid"
    STAMP_UNIT = "stamp_unit"
    STAMP_TWICE = "stamp_twice"
    STAMP_LATE = "stamp_late"
    STAMP_AHEAD = "stamp_ahead"
    CLOCK_JUMPED = "clock_jumped"
    CLOCK_SET_BACK = "clock_set_back"
    STREAM_LOOPED = "stream_looped"
    ODOMETRY_LEFT_OUT = "odometry_left_out"
    NOTHING_COUNTED = "nothing_counted"
    POSE_OUTDATED = "pose_outdated"
    MAP_CANNOT_TELL = "map_cannot_tell"
    FASTER_THAN_BELIEVED = "faster_than_believed"
    CAMERA_CONTRADICTED = "camera_contradicted"

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return _REMEDIES[self]


_REMEDIES = {
    Reason.IMAGE_UNUSABLE: "check the camera and the files",
    Reason.IMAGE_BLANK: "check exposure and lens",
    Reason.IMAGE_FROZEN: "restart the camera",
    Reason.FITS_NOWHERE: "drive back to where the map was taken, or extend the map",
    Reason.STAMP_INVALID: "stamp images with seconds",
    Reason.STAMP_UNIT: "give seconds",
    Reason.STAMP_TWICE: "the stream seems to loop or to repeat its stamps; stamp every image when it is taken",
    Reason.STAMP_LATE: "stamp images and odometry with one clock",
    Reason.STAMP_AHEAD: "stamp images and odometry with one clock",
    Reason.CLOCK_JUMPED: "keep the clock steady",
    Reason.CLOCK_SET_BACK: "keep the clock steady",
    Reason.STREAM_LOOPED: "begin with a new localizer where a recording begins again",
    Reason.ODOMETRY_LEFT_OUT: "check odometry",
    Reason.NOTHING_COUNTED: "look at the reasons of the images before",
    Reason.POSE_OUTDATED: "stamp images and odometry with one clock",
    Reason.MAP_CANNOT_TELL: "drive on, or add references off their line",
    Reason.FASTER_THAN_BELIEVED: "raise localizer.motion.image_only_speed_m_s",
    Reason.CAMERA_CONTRADICTED: "the camera may not be as it is described: panoloc calibrate looks for that",
}


class Finding(str):
    """One line on what happened, with its reason; empty if nothing did.

    Parameters
    ----------
    text : str
    reason : Reason, optional
    """

    __slots__ = ("reason",)
    reason: Reason | None

    def __new__(cls, text: str = "", reason: Reason | None = None) -> Self:
        """A line, and why."""
        finding = super().__new__(cls, text)
        finding.reason = reason
        return finding

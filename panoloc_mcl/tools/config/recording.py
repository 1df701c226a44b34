"""What a run must be told of recordings in layouts that do not say it themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, create_model

from panoloc_mcl.robot.settings.validation import StrictModel

Topic = Annotated[str, Field(min_length=1, max_length=200)]


class RecordingSettings(StrictModel):
    """Recordings (bags, videos, folders of images): where what is in them."""

    image_topic: Topic | tuple[Topic, Topic] | None = Field(
        None,
        description="Topic of the images; null = the only one there is. Two, `[front, back]`: of two fisheyes that are triggered "
        "together; their images are joined from left to right (camera kind `fisheye_pair`).",
    )
    odometry_topic: Topic | None = Field(
        None,
        description="Topic of odometry (nav_msgs/Odometry); null = the only one there is, or else the transform `odom` to "
        "`base_link`.",
    )
    truth_topic: Topic | None = Field(
        None,
        description="Topic of the true poses (PoseStamped, PoseWithCovarianceStamped or Odometry, in the map's frame); null = the only "
        "PoseStamped there is, or else the transform `map` to `base_link`.",
    )
    camera: Path | None = Field(
        None,
        description="File that describes the camera (as `camera.yaml` of a data set); null = `camera.yaml` beside the recording, or "
        "else the camera that the map was made with.",
    )
    map_frame: Topic = Field("map", description="Name of the map's frame.")
    odom_frame: Topic = Field("odom", description="Name of odometry's frame.")
    base_frame: Topic = Field(
        "base_link", description="Name of the robot's frame (`base_link` also stands for `base_footprint`)."
    )
    stamps: Literal["header", "recorded"] = Field(
        "header",
        description="header: when the camera took the image; recorded: when the bag got it, for drivers whose stamps are wrong.",
    )


# By a function, since `from` is a word of Python's.
ReferencesSettings = create_model(
    "ReferencesSettings",
    __base__=StrictModel,
    __doc__="References taken from a drive with known poses.",
    **{  # type: ignore[call-overload]
        "from": (
            str,
            Field(min_length=1, description="Name of the sequence whose images become references, at their true poses."),
        ),
        "every_m": (
            float,
            Field(0.5, gt=0.0, le=1e3, description="An image becomes one if it lies this far from all others, m."),
        ),
    },
)

"""Settings of the map: where it is, and how it is made."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from panoloc_mcl.robot.settings.validation import StrictModel

Positive = Annotated[float, Field(gt=0.0)]


class MapSettings(StrictModel):
    """The map: a file, or how it is made of references or of drives. A path alone, `map: FILE`, names the file."""

    file: Path | None = Field(
        None, description="A map file made by `panoloc build-map`; null = build from the references, cached."
    )
    mend: bool = Field(
        True,
        description="Whether the poses of references are mended by what their images say of each other. Needs the camera's height.",
    )
    sd_xy_m: Positive | None = Field(
        None,
        le=100.0,
        description="Standard deviation of the given x and y, m; null = estimated. Columns `sd_xy`, `sd_theta` of poses.csv beat it.",
    )
    sd_theta_deg: Positive | None = Field(
        None, le=180.0, description="Standard deviation of the given headings, degrees; null = estimated."
    )
    find_body: bool = Field(
        True,
        description="Whether the robot is looked for in the images that the map is made of, where their camera has no mask, and left "
        "out of them and of later images of that camera.",
    )
    find_tilt: bool = Field(
        True,
        description="Whether it is found how the camera of the references leans, where `camera.mount` says nothing of pitch and roll. "
        "Needs `map.mend`; later images of the same camera lean as much.",
    )
    neighbours: Annotated[int, Field(ge=2, le=32)] = Field(6, description="Keyframes that each one is measured against.")
    rounds: Annotated[int, Field(ge=1, le=20)] = Field(
        4, description="Rounds of depths, relative poses and pose graph at most; they end when nothing moves."
    )
    keyframe_distance_m: Positive = Field(
        0.25, le=10.0, description="Of a drive, an image becomes a keyframe this far from the last one, m."
    )
    most_keyframes: Annotated[int, Field(ge=2, le=100_000)] = Field(
        1000, description="Keyframes that a map holds at most when `panoloc update-map` adds some."
    )

    @model_validator(mode="before")
    @classmethod
    def _path_alone(cls, data: Any) -> Any:
        return data if isinstance(data, dict) else {"file": data}

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [handler(core_schema), {"type": "string", "format": "path"}, {"type": "null"}]}

"""The configuration of a live robot: the map, where messages come from, where poses go."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.validation import StrictModel, read_yaml, validate
from panoloc_mcl.tools.config.overrides import Override, apply, parse_overrides, source_at
from panoloc_mcl.tools.config.recording import RecordingSettings


class InputSettings(StrictModel):
    """Where messages come from: one of `video` and `recording`."""

    video: int | str | None = Field(
        None, description="A camera's number (`0`), a stream (`rtsp://…`) or a video file, by OpenCV."
    )
    recording: str | None = Field(None, description="A recording or a data set that is played.")
    sequence: str | None = Field(None, description="Which of its sequences; null = the only one.")
    rate: Annotated[float, Field(ge=0.0, le=1000.0)] = Field(
        1.0, description="How fast it is played; 1 = as it was recorded, 0 = every image, as fast as they are processed."
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> InputSettings:
        if (self.video is None) == (self.recording is None):
            raise ValueError("needs video or recording, and not both; leave one out")
        return self


class FoxgloveSettings(StrictModel):
    """A WebSocket that Foxglove's app connects to."""

    enabled: bool = Field(False, description="Whether to serve.")
    host: str = Field("127.0.0.1", description="Address to serve on; `0.0.0.0` for other machines.")
    port: Annotated[int, Field(ge=0, le=65535)] = Field(8765, description="Port; 0 = any free one, which is printed.")


class OutputSettings(StrictModel):
    """Where poses go."""

    json_lines: bool = Field(True, description="One JSON object a line on standard output for every image.")
    movements: bool = Field(False, description="A line for every odometry measurement, too.")
    foxglove: FoxgloveSettings = Field(default_factory=FoxgloveSettings, description="Foxglove.")
    rerun: str | None = Field(None, description="A file for the Rerun viewer (`run.rrd`), or `live` for the viewer itself.")
    record: Path | None = Field(None, description="MCAP file that images, odometry and poses are recorded in.")


class StateSettings(StrictModel):
    """A state that outlives the program."""

    file: Path | None = Field(None, description="Where it is kept; the next start goes on from it. null = nowhere.")
    every_s: Annotated[float, Field(gt=0.0, le=3600.0)] = Field(10.0, description="How often it is saved, s; also at exit.")


class TransitionSettings(StrictModel):
    """A lift, ramp or door that leads from one of the maps to another."""

    between: tuple[str, str] = Field(description="Names of the two maps: their files without the ending.")
    at: tuple[tuple[float, float], tuple[float, float]] = Field(
        description="x and y of its ends, m, each in the frame of its map."
    )
    radius_m: Annotated[float, Field(gt=0.0, le=100.0)] = Field(
        1.5, description="How near a robot comes to an end that takes it, m."
    )


class LiveConfig(LocalizerConfig):
    """A running robot."""

    map: Path | None = Field(None, description="Map file, from `panoloc build-map`.")
    maps: list[Path] = Field(
        default_factory=list,
        description="Instead of `map`, several map files, such as one per floor; the robot may be on any of them.",
    )
    transitions: list[TransitionSettings] = Field(
        default_factory=list, description="Where the robot changes from one of `maps` to another, if that is known."
    )
    camera: Path | None = Field(None, description="camera.yaml of the robot's camera; null = as the map's, or the recording's.")
    input: InputSettings = Field(description="Where messages come from.")
    recording: RecordingSettings = Field(
        default_factory=RecordingSettings, description="What recordings do not say themselves."
    )
    output: OutputSettings = Field(default_factory=OutputSettings, description="Where poses go.")
    state: StateSettings = Field(default_factory=StateSettings, description="What outlives the program.")
    missing_after_s: Annotated[float, Field(gt=0.0, le=3600.0)] = Field(
        5.0, description="Seconds without images or odometry after which a warning names what is missing."
    )

    @model_validator(mode="after")
    def _one_map_or_several(self) -> LiveConfig:
        if (self.map is None) == (not self.maps):
            raise ValueError("needs map or maps, and not both; leave one out")
        names = [path.stem for path in self.maps]
        if len(set(names)) < len(names):
            raise ValueError(f"maps: two files have one name ({', '.join(names)}); rename one")
        for way in self.transitions:
            for name in way.between:
                if name not in names:
                    raise ValueError(f"transitions: between = {name}: is none of maps; known: {', '.join(names) or 'none'}")
        return self

    @property
    def every_map(self) -> list[Path]:
        """The files of all maps."""
        return self.maps if self.map is None else [self.map]


def load_live_config(path: str | Path, overrides: Sequence[str | Override] = ()) -> LiveConfig:
    """Read the configuration of `panoloc live`, as `load_config` reads that of a run.

    Raises
    ------
    ConfigError
        With every fault found, one line each.
    """
    data, parsed = read_yaml(Path(path)), parse_overrides(overrides)
    for override in parsed:
        apply(data, override)
    return validate(LiveConfig, data, lambda location: source_at(location, parsed, str(path)))

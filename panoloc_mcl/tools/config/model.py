"""The run configuration: every parameter with its unit, default, range and effect.

The descriptions of these fields are the parameter reference (``CONFIGURATION.md``, see `panoloc_mcl.tools.config.reference`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.validation import StrictModel
from panoloc_mcl.tools.config.recording import RecordingSettings, ReferencesSettings


class KidnapSettings(StrictModel):
    """Carrying the robot away: sequences of one light are cut and spliced, odometry silent."""

    every_frames: Annotated[int, Field(ge=0, le=1_000_000)] = Field(0, description="Frames between two kidnaps; 0 = never.")


class RunConfig(LocalizerConfig):
    """One run: a data set, a map, a localizer, what to write."""

    name: str = Field(
        "run", min_length=1, max_length=80, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", description="Folder name under `out`."
    )
    dataset: str = Field(
        "hall",
        min_length=1,
        description="Path of a data set, a recording (bag, mcap, video, folder) or a folder of recordings, or the name of an embedded "
        "data set (`hall`).",
    )
    recording: RecordingSettings = Field(
        default_factory=RecordingSettings, description="What recordings do not say themselves."
    )
    references: ReferencesSettings | None = Field(
        None, description="References taken from a sequence with true poses; null = those of the data set."
    )
    sequences: Literal["all"] | list[str] = Field("all", description="`all`, or a list of names or globs such as `noon_*`.")
    map: MapSettings = Field(
        default_factory=MapSettings, description="The map: a file, or how it is made. `map: FILE` alone names the file."
    )
    runs: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        1, description="How often each sequence is run, with seeds seed, seed + 1, …"
    )
    out: Path = Field(Path("results"), description="Folder the results folder is made in.")
    kidnap: KidnapSettings = Field(default_factory=KidnapSettings, description="Kidnapping.")

"""The settings of one localizer: all that it is told but its map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.robot.settings.observation import ObservationSettings, all_observation_settings
from panoloc_mcl.robot.settings.validation import StrictModel

if not TYPE_CHECKING:
    ObservationSettings = all_observation_settings()

__all__ = ["LocalizerConfig", "ObservationSettings"]


class LocalizerConfig(StrictModel):
    """What a localizer needs beside its map: how images are looked at, how poses are tracked, and the seed."""

    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(0, description="Seed of everything random.")
    observation: ObservationSettings = Field(default_factory=ObservationSettings, description="The observation model.")
    localizer: LocalizerSettings = Field(default_factory=LocalizerSettings, description="The localizer.")

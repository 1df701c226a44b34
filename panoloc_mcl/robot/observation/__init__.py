"""Observation models: an image in, a vote field over headings and places out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.observation.base import ObservationModel
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.observation.votes import VotesModel
from panoloc_mcl.robot.settings.observation import MODELS, OBSERVING, ObservationSettings, load


def model_named(name: str) -> type[ObservationModel]:
    """The class of an observation model, imported at first use.

    Raises
    ------
    ConfigError
        There is none of that name, or it belongs to a part of the package that is not installed.
    """
    if name not in MODELS:
        raise ConfigError(f"observation.model = '{name}': unknown; known: {', '.join(MODELS)}")
    try:
        model: type[ObservationModel] = load(MODELS[name].model)
    except ModuleNotFoundError as error:
        raise ConfigError(f"observation.model = '{name}': needs {error.name}, which is not installed; install it") from error
    return model


def build_settings(observation: ObservationSettings) -> dict[str, Any]:
    """What a map depends on: the selected model and those of its settings that do not only matter when an image is looked at."""
    return {"model": observation.model, "settings": _without_observing(observation.selected)}


def differences(asked: ObservationSettings, built: ObservationSettings) -> tuple[str, ...]:
    """What of `build_settings` is asked for otherwise than a map was built with: a line of settings for each."""
    if asked.model != built.model:
        return (f"observation.model = {asked.model} and not {built.model}",)
    mine, theirs = (dict(_dotted(build_settings(one)["settings"], f"observation.{one.model}")) for one in (asked, built))
    return tuple(f"{key} = {value} and not {theirs[key]}" for key, value in mine.items() if value != theirs[key])


def _dotted(values: dict[str, Any], under: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _dotted(value, f"{under}.{name}")
        else:
            yield f"{under}.{name}", value


def _without_observing(settings: BaseModel) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for name, field in type(settings).model_fields.items():
        if field.json_schema_extra == OBSERVING:
            continue
        value = getattr(settings, name)
        kept[name] = _without_observing(value) if isinstance(value, BaseModel) else value
    return kept


__all__ = ["MODELS", "ObservationModel", "Places", "VoteField", "VotesModel", "build_settings", "differences", "model_named"]

"""Observation models: an image in, a vote field over headings and places out."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from panoloc_mcl.config.model import OBSERVING, ObservationSettings
from panoloc_mcl.observation.base import ObservationModel
from panoloc_mcl.observation.field import VoteField
from panoloc_mcl.observation.paper import PaperModel
from panoloc_mcl.observation.peers import (
    EigenspaceModel,
    FourierSignatureModel,
    LeastSquaresModel,
    OrientationCorrelationModel,
    SpinningModel,
    ZeroPhaseModel,
)
from panoloc_mcl.observation.places import Places
from panoloc_mcl.observation.votes import VotesModel

MODELS: dict[str, type[ObservationModel]] = {
    model.name: model
    for model in (
        VotesModel,
        PaperModel,
        FourierSignatureModel,
        EigenspaceModel,
        LeastSquaresModel,
        SpinningModel,
        ZeroPhaseModel,
        OrientationCorrelationModel,
    )
}


def settings_of(observation: ObservationSettings) -> Any:
    """The settings of the selected model."""
    return getattr(observation, observation.model)


def build_settings(observation: ObservationSettings) -> dict[str, Any]:
    """What a map depends on: the selected model and those of its settings that do not only matter when an image is looked at."""
    return {"model": observation.model, "settings": _without_observing(settings_of(observation))}


def _without_observing(settings: BaseModel) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for name, field in type(settings).model_fields.items():
        if field.json_schema_extra == OBSERVING:
            continue
        value = getattr(settings, name)
        kept[name] = _without_observing(value) if isinstance(value, BaseModel) else value
    return kept


__all__ = ["MODELS", "ObservationModel", "PaperModel", "Places", "VoteField", "VotesModel", "build_settings", "settings_of"]

"""Observation models: an image in, a vote field over headings and places out."""

from __future__ import annotations

from typing import Any

from panoloc_mcl.config.model import ObservationSettings
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


__all__ = ["MODELS", "ObservationModel", "PaperModel", "Places", "VoteField", "VotesModel", "settings_of"]

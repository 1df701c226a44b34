"""Localization of a robot from panoramic images, from nothing: votes in an eigenspace, fused by a Monte Carlo localizer."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from panoloc_mcl.robot.camera import OmniCamera, PanoramaCamera
    from panoloc_mcl.robot.errors import (
        CameraError,
        ConfigError,
        DatasetError,
        ImageError,
        MapError,
        MeasurementError,
        OutputError,
        PanolocError,
        StateError,
    )
    from panoloc_mcl.robot.filters import Cluster, Estimate, FilterState, Status
    from panoloc_mcl.robot.interface.answers import Location, TimedPose
    from panoloc_mcl.robot.interface.keeper import StateKeeper
    from panoloc_mcl.robot.interface.messages import Image, Odometry, Truth
    from panoloc_mcl.robot.localizer import Localizer
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.robot.observation import ObservationModel, Places, VoteField
    from panoloc_mcl.robot.settings.config import LocalizerConfig
    from panoloc_mcl.tools.config import RunConfig, load_config
    from panoloc_mcl.tools.datasets import read_dataset

__version__ = "0.1.0"

# Looked up at first use, so that importing the package costs nothing.
_HOMES = {
    "CameraError": "robot.errors",
    "Cluster": "robot.filters",
    "ConfigError": "robot.errors",
    "DatasetError": "robot.errors",
    "Estimate": "robot.filters",
    "FilterState": "robot.filters",
    "FloorLocalizer": "robot.floors",
    "Image": "robot.interface.messages",
    "ImageError": "robot.errors",
    "Localizer": "robot.localizer",
    "LocalizerConfig": "robot.settings.config",
    "Location": "robot.interface.answers",
    "MapError": "robot.errors",
    "MeasurementError": "robot.errors",
    "ObservationModel": "robot.observation",
    "Odometry": "robot.interface.messages",
    "OmniCamera": "robot.camera",
    "OutputError": "robot.errors",
    "PanolocError": "robot.errors",
    "PanoramaCamera": "robot.camera",
    "PanoramaMap": "robot.map.panorama_map",
    "Places": "robot.observation",
    "RunConfig": "tools.config",
    "StateError": "robot.errors",
    "StateKeeper": "robot.interface.keeper",
    "Status": "robot.filters",
    "TimedPose": "robot.interface.answers",
    "Transition": "robot.floors",
    "Truth": "robot.interface.messages",
    "VoteField": "robot.observation",
    "load_config": "tools.config",
    "read_dataset": "tools.datasets",
}

__all__ = [
    "CameraError",
    "Cluster",
    "ConfigError",
    "DatasetError",
    "Estimate",
    "FilterState",
    "FloorLocalizer",
    "Image",
    "ImageError",
    "Localizer",
    "LocalizerConfig",
    "Location",
    "MapError",
    "MeasurementError",
    "ObservationModel",
    "Odometry",
    "OmniCamera",
    "OutputError",
    "PanolocError",
    "PanoramaCamera",
    "PanoramaMap",
    "Places",
    "RunConfig",
    "StateError",
    "StateKeeper",
    "Status",
    "TimedPose",
    "Transition",
    "Truth",
    "VoteField",
    "load_config",
    "read_dataset",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'panoloc_mcl' has no attribute '{name}'")
    return getattr(importlib.import_module(f"panoloc_mcl.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

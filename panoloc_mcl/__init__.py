"""Localization of a robot from panoramic images, from nothing: votes in an eigenspace, fused by a Monte Carlo localizer."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from panoloc_mcl.robot.errors import PanolocError
    from panoloc_mcl.robot.filters import Estimate, Status
    from panoloc_mcl.robot.localizer import Localizer
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.tools.config import RunConfig, load_config
    from panoloc_mcl.tools.datasets import read_dataset

__version__ = "0.1.0"

# Looked up at first use, so that importing the package costs nothing.
_HOMES = {
    "Estimate": "robot.filters",
    "Localizer": "robot.localizer",
    "PanolocError": "robot.errors",
    "PanoramaMap": "robot.map.panorama_map",
    "RunConfig": "tools.config",
    "Status": "robot.filters",
    "load_config": "tools.config",
    "read_dataset": "tools.datasets",
}

__all__ = ["Estimate", "Localizer", "PanolocError", "PanoramaMap", "RunConfig", "Status", "load_config", "read_dataset"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'panoloc_mcl' has no attribute '{name}'")
    return getattr(importlib.import_module(f"panoloc_mcl.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

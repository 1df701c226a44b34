"""Localization of a robot from panoramic images, from nothing: votes in an eigenspace, fused by a Monte Carlo localizer."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from panoloc_mcl.config import RunConfig, load_config
    from panoloc_mcl.datasets import read_dataset
    from panoloc_mcl.errors import PanolocError
    from panoloc_mcl.filters import Estimate, Status
    from panoloc_mcl.localizer import Localizer
    from panoloc_mcl.panorama_map import PanoramaMap

__version__ = "0.1.0"

# Looked up at first use, so that importing the package costs nothing.
_HOMES = {
    "Estimate": "filters",
    "Localizer": "localizer",
    "PanolocError": "errors",
    "PanoramaMap": "panorama_map",
    "RunConfig": "config",
    "Status": "filters",
    "load_config": "config",
    "read_dataset": "datasets",
}

__all__ = ["Estimate", "Localizer", "PanolocError", "PanoramaMap", "RunConfig", "Status", "load_config", "read_dataset"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'panoloc_mcl' has no attribute '{name}'")
    return getattr(importlib.import_module(f"panoloc_mcl.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

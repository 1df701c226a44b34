"""Maps that runs built, kept under the hash of everything they depend on."""

from __future__ import annotations

import hashlib
import json
import re
import time
import warnings
from dataclasses import replace
from pathlib import Path

from panoloc_mcl.robot.camera import to_mapping
from panoloc_mcl.robot.errors import MapError, OutputError
from panoloc_mcl.robot.files import cache_folder, known_errors, write_atomically
from panoloc_mcl.robot.images import image_bytes
from panoloc_mcl.robot.map.map_file import FORMAT
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import build_settings, model_named
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.source import OF_MAPS, source_digest
from panoloc_mcl.tools.conventions import reference_findings
from panoloc_mcl.tools.datasets import Dataset

_PEERS = "laboratory/peers/"
_SECONDS = ".seconds"


def cached_map(
    dataset: Dataset,
    observation: ObservationSettings,
    seed: int,
    progress: Progress = no_progress,
    settings: MapSettings | None = None,
) -> PanoramaMap:
    """The map of a data set: from the cache if it was built before, else built and kept.

    A cache that cannot be written costs a warning and the time to build, never the run.

    Raises
    ------
    MapError, DatasetError, ImageError
        As `PanoramaMap.build`.
    """
    path = _path(dataset, observation, seed, settings)
    try:
        with known_errors(MapError, path):
            kept = path.is_file()
        if kept:
            return PanoramaMap.load(path)
    except MapError as error:
        warnings.warn(f"cached map left aside: {error}", RuntimeWarning, stacklevel=2)
    begun = time.process_time()
    built = PanoramaMap.build(dataset, observation, seed, progress, settings)
    spent = time.process_time() - begun
    built = replace(built, notes=(*reference_findings(dataset.references), *built.notes))
    try:
        built.save(path)
        write_atomically(path.with_suffix(_SECONDS), f"{spent:.3f}\n")
    except OutputError as error:
        warnings.warn(f"map not kept for the next run: {error}", RuntimeWarning, stacklevel=2)
    return built


def cost_of_map(
    dataset: Dataset, observation: ObservationSettings, seed: int, settings: MapSettings | None = None
) -> tuple[float, float]:
    """Seconds of the processor that the map in the cache took to build, and the megabytes of its file; NaN where it is not known."""
    path = _path(dataset, observation, seed, settings)
    try:
        return float(path.with_suffix(_SECONDS).read_text()), path.stat().st_size / 1e6
    except (OSError, ValueError):
        return float("nan"), path.stat().st_size / 1e6 if path.is_file() else float("nan")


def _path(dataset: Dataset, observation: ObservationSettings, seed: int, settings: MapSettings | None) -> Path:
    # The name only helps people; it is free text and must not lead out of the folder.
    readable = re.sub(r"[^A-Za-z0-9_-]+", "_", dataset.name)[:40]
    return cache_folder() / "maps" / f"{readable}-{_key(dataset, observation, seed, settings or MapSettings())}.panomap"


def _key(dataset: Dataset, observation: ObservationSettings, seed: int, settings: MapSettings) -> str:
    references, model = dataset.references, model_named(observation.model)
    digest = hashlib.sha256()
    description = {
        "format": FORMAT,
        "code": source_digest((*OF_MAPS, *((_PEERS,) if model.__module__.startswith("panoloc_mcl.laboratory") else ()))),
        "camera": to_mapping(references.camera),
        "poses": references.poses.tolist(),
        "sds": None if references.sds is None else references.sds.tolist(),
        "map": settings.model_dump(mode="json", exclude={"file"}),
        "files": [file.name for file in references.files],
        **build_settings(observation),
        "seed": seed if model.draws else 0,
    }
    digest.update(json.dumps(description, sort_keys=True).encode())
    for file in references.files:
        digest.update(hashlib.sha256(image_bytes(file)).digest())
    return digest.hexdigest()[:24]

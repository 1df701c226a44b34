"""How far the making of a map has come, in a file beside it: a build that was stopped goes on after its last stage."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import to_mapping
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.images import image_bytes
from panoloc_mcl.robot.map.drives.drive import Drive
from panoloc_mcl.robot.map.keyframes import EDGE_ARRAYS, Edges
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings

Float64 = NDArray[np.float64]

# Of what is kept; another version begins anew.
_FORMAT = "panoloc-stages/1"
_VIEWS = ("turned", "at", "profiles")


@dataclass(frozen=True, eq=False)
class Stage:
    """What is known after a stage.

    Parameters
    ----------
    number : int
    drives : list of int
        Of those given, the ones that the map is made of.
    notes : list of str
    settled : bool
        Nothing moves any more.
    poses, covariances : float64 (n, 3) and (n, 3, 3)
    edges : Edges
        Those of odometry, too.
    sufficient : float
        Agreement (cosine) of a pair that counts.
    views : tuple of three float64 arrays, optional
        Where views are made from still: headings by which the panoramas were turned (n,), positions (n, 2), profiles (n, columns).
    """

    number: int
    drives: list[int]
    notes: list[str]
    settled: bool
    poses: Float64
    covariances: Float64
    edges: Edges
    sufficient: float = 0.0
    views: tuple[Float64, Float64, Float64] | None = None


class Stages:
    """Results of stages, kept for the same drives and settings.

    Parameters
    ----------
    path : Path, optional
        The file; without one nothing is kept.
    drives : sequence of Drive
    votes : VotesSettings
    settings : MapSettings
    """

    def __init__(self, path: Path | None, drives: Sequence[Drive], votes: VotesSettings, settings: MapSettings) -> None:
        self._path = path
        self._key = "" if path is None else _key(drives, votes, settings)

    def last(self) -> Stage | None:
        """The last stage that was kept; None where nothing fits."""
        if self._path is None or not self._path.is_file():
            return None
        try:
            header, read = read_arrays(self._path)
        except (ValueError, OSError):
            return None
        if header.pop("key", None) != self._key:
            return None
        arrays: dict[str, NDArray[Any]] = {**read}
        edges = Edges(**{name: arrays[f"edges.{name}"] for name in EDGE_ARRAYS})
        turned, at, profiles = (arrays.get(name) for name in _VIEWS)
        views = None if turned is None or at is None or profiles is None else (turned, at, profiles)
        return Stage(**header, poses=arrays["poses"], covariances=arrays["covariances"], edges=edges, views=views)

    def keep(self, stage: Stage) -> None:
        """Keep a stage instead of the one before.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        if self._path is None:
            return
        header = {name: getattr(stage, name) for name in ("number", "drives", "notes", "settled", "sufficient")}
        arrays = {"poses": stage.poses, "covariances": stage.covariances}
        arrays |= {f"edges.{name}": getattr(stage.edges, name) for name in EDGE_ARRAYS}
        arrays |= dict(zip(_VIEWS, stage.views or (), strict=False))
        write_arrays(self._path, {**header, "key": self._key}, arrays)


def _key(drives: Sequence[Drive], votes: VotesSettings, settings: MapSettings) -> str:
    said = {
        "format": _FORMAT,
        "drives": [[drive.name, to_mapping(drive.camera), *drive.image_size, *sorted(drive.doubted)] for drive in drives],
        "votes": votes.model_dump(mode="json"),
        "map": settings.model_dump(mode="json", exclude={"file"}),
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for drive in drives:
        digest.update(drive.times.tobytes() + drive.odometry.tobytes())
        for file in drive.files:
            digest.update(hashlib.sha256(image_bytes(file)).digest())
    return digest.hexdigest()

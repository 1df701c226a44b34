"""Maps of the simulated building, and images of it that no map was made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.benchmarks.campus.rooms import HEIGHT_M, SIZE_M, rooms
from panoloc_mcl.robot.camera import PanoramaCamera, PanoramaGeometry
from panoloc_mcl.robot.files import cache_folder
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import ObservationSettings, VotesSettings
from panoloc_mcl.robot.source import source_digest
from panoloc_mcl.robot.unfinished import remove_parts

Float64 = NDArray[np.float64]

#: Of the panoramas; 0.4 times as many rows.
COLUMNS = 160
ELEVATION_DEG = (-50.0, 25.0)
# Two metres apart, and as far from the walls as that leaves.
_GRID = np.array([(1.7 + 2.0 * column, 1.7 + 2.0 * row) for row in range(3) for column in range(4)])
# Robots keep away from the walls.
_MARGIN_M = 0.8


def geometry(columns: int = COLUMNS) -> PanoramaGeometry:
    """Of all its panoramas."""
    return PanoramaGeometry(columns, round(0.4 * columns), *ELEVATION_DEG)


def path_of(count: int, columns: int = COLUMNS) -> Path:
    """Where the map of so many rooms is kept, for this version of the code that makes it."""
    parts = ("robot/observation", "robot/synthesis", "robot/eigenspace", "laboratory/benchmarks/campus/rooms.py")
    return cache_folder() / "campus" / f"{count}-rooms-{columns}-{source_digest(parts)[:12]}.panomap"


def build(count: int, columns: int = COLUMNS, progress: Progress = no_progress) -> Path:
    """The map of so many rooms, from twelve references each, made on one thread and kept for the next time."""
    path = path_of(count, columns)
    if path.exists():
        return path
    every, shape = rooms(count), geometry(columns)
    positions = np.concatenate([room.corner + _GRID for room in every])
    pixels = [room.panorama(shape, np.array([*(room.corner + at), 0.0])) for room in every for at in _GRID]
    names = tuple(f"room_{room.number}_{index}.png" for room in every for index in range(len(_GRID)))
    references = ReferencePanoramas(np.stack(pixels), None, positions, names, shape, HEIGHT_M)
    del pixels
    # Poses are exact: to look for better ones of references that fit badly takes as many views as the map has, for each.
    votes = {"columns": columns, "doubted_references": "keep", "virtual_places": {"threads": 1}}
    observation = ObservationSettings(votes=VotesSettings.model_validate(votes))
    # What is done is kept: a build that was stopped goes on.
    parts = path.with_suffix(".parts")
    with threadpool_limits(1, user_api="blas"):
        model = VotesModel.build(references, observation.votes, 0, progress, parts)
    camera = PanoramaCamera(elevation_deg=ELEVATION_DEG, height_m=HEIGHT_M)
    keyframes = Keyframes.surveyed(names, np.pad(positions, ((0, 0), (0, 1))))
    made = PanoramaMap(
        f"{count} rooms", references, camera, shape.shape[::-1], observation, 0, model.arrays(), keyframes, model.notes
    )
    made.save(path)
    remove_parts(parts)
    return path


def held_out(count: int, images: int, columns: int = COLUMNS, seed: int = 1) -> list[tuple[NDArray[np.uint8], Float64]]:
    """Images from anywhere in any of so many rooms, at any heading, 0.6 to 1.2 times as bright, and their poses (3,)."""
    rng, every, shape = np.random.default_rng([3, seed, count]), rooms(count), geometry(columns)
    found = []
    for _ in range(images):
        room = every[int(rng.integers(count))]
        inside = room.corner + rng.uniform(_MARGIN_M, np.array(SIZE_M) - _MARGIN_M)
        pose = np.array([*inside, rng.uniform(-np.pi, np.pi)])
        found.append((room.panorama(shape, pose, rng.uniform(0.6, 1.2)), pose))
    return found

"""Renders the room as a data set: references on a grid at noon, drives under three lights."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from oracles.furnished_room.drive import noisy_odometry, wander
from oracles.furnished_room.light import LIGHTS
from oracles.furnished_room.render import RoomRenderer
from oracles.furnished_room.scene import furnished_room

from panoloc_mcl.robot.camera.panorama import PanoramaGeometry
from panoloc_mcl.robot.camera.spec import PanoramaCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.datasets.writer import DatasetWriter

Progress = Callable[[int, int], None]

CAMERA_HEIGHT_M = 0.6
GEOMETRY = PanoramaGeometry(360, 145, -50.0, 25.0)
GRID = tuple((float(x), float(y)) for y in range(4) for x in range(5))

_START_S = 1000.0
_FRAME_S = 1.0
_ODOMETRY_S = 1.0 / 6.0
_ODOMETRY_LEAD_S = 0.037  # its stamps are not those of the frames


def build_room(
    path: Path,
    seed: int = 7,
    frames: int = 20,
    geometry: PanoramaGeometry = GEOMETRY,
    grid: tuple[tuple[float, float], ...] = GRID,
    lights: tuple[str, ...] = tuple(LIGHTS),
    progress: Progress | None = None,
) -> Path:
    """Render the data set; the same arguments give the same bytes.

    Parameters
    ----------
    path : Path
        A folder that does not exist yet, or is empty.
    seed : int
        Of pictures, drives and noise.
    frames : int
        In each sequence, about a second apart.
    geometry : PanoramaGeometry
        Size and elevations of the panoramas.
    grid : tuple of (float, float)
        Places of the references, taken at heading 0 at noon.
    lights : tuple of str
        One sequence each: ``noon``, ``afternoon``, ``evening``.
    progress : callable, optional
        Called with the number of images done and the number of all.

    Raises
    ------
    DatasetError
        The folder is not empty, a file cannot be written, or a light has no such name.
    """
    unknown = [light for light in lights if light not in LIGHTS]
    if unknown:
        raise DatasetError(f"lights: unknown '{unknown[0]}'; known: {', '.join(LIGHTS)}")
    room = furnished_room(seed)
    total, done = len(grid) + frames * len(lights), 0

    def shots(renderer: RoomRenderer, poses: NDArray[np.float64], rng: np.random.Generator) -> Iterator[NDArray[np.uint8]]:
        nonlocal done
        for pose in poses:
            yield renderer.render(pose, rng)
            done += 1
            if progress is not None:
                progress(done, total)

    camera = PanoramaCamera(elevation_deg=(geometry.elevation_bottom_deg, geometry.elevation_top_deg), height_m=CAMERA_HEIGHT_M)
    writer = DatasetWriter(
        path,
        "room",
        camera,
        description="A furnished room of 6 m x 5 m, drawn by ray casting; noon, afternoon and evening",
        licence="CC0-1.0",
    )
    noon = RoomRenderer(room, LIGHTS["noon"], geometry, CAMERA_HEIGHT_M)
    places = np.array([(x, y, 0.0) for x, y in grid])
    writer.add_references(shots(noon, places, np.random.default_rng([seed, 1])), places)
    for light in lights:
        # Seeded by the light's place in the list of all, so that leaving one out does not change the others.
        rng = np.random.default_rng([seed, 2, list(LIGHTS).index(light)])
        renderer = noon if light == "noon" else RoomRenderer(room, LIGHTS[light], geometry, CAMERA_HEIGHT_M)
        times, odometry, truth = _drive(frames, wander(room, (frames + 1) * _FRAME_S, rng), rng)
        images = shots(renderer, truth.poses, rng)
        writer.add_sequence(f"{light}_00", times, images, odometry, truth)
    return writer.finish()


def _drive(frames: int, path: Trajectory, rng: np.random.Generator) -> tuple[NDArray[np.float64], Trajectory, Trajectory]:
    """Stamps of the frames, the odometry, and the true poses at the frames."""
    # Rounded as in the files, so that the poses belong to the stamps that will be read.
    since = np.round(0.1 + np.arange(frames) * _FRAME_S + rng.uniform(-0.03, 0.03, frames), 6)
    reports = np.arange(0.1 - _ODOMETRY_LEAD_S, since[-1] + 1.5 * _ODOMETRY_S, _ODOMETRY_S)
    odometry = noisy_odometry(path, reports, rng)
    shifted = Trajectory(np.round(_START_S + reports, 6), odometry.poses)
    times = np.round(_START_S + since, 6)
    return times, shifted, Trajectory(times, path.at(since))

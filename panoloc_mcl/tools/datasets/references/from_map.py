"""A map's keyframes as a data set: references with the poses that the map holds."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from panoloc_mcl.robot.camera.spec import PanoramaCamera
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.datasets.writer import DatasetWriter

if TYPE_CHECKING:
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap


def write_map_as_dataset(panorama_map: PanoramaMap, path: Path) -> Path:
    """Write the keyframes of a map as a data set.

    The images are the map's panoramas, turned to heading 0, so their poses have heading 0; what the camera did not see is black, which
    counts as masked. Positions are those of the camera.

    Raises
    ------
    DatasetError
        The folder is not empty, or a file cannot be written.
    """
    references, keyframes = panorama_map.references, panorama_map.keyframes
    geometry = references.geometry
    camera = PanoramaCamera(
        elevation_deg=(geometry.elevation_bottom_deg, geometry.elevation_top_deg), height_m=references.camera_height_m
    )
    writer = DatasetWriter(path, panorama_map.name, camera, f"keyframes of the map {panorama_map.name}")
    images = (
        pixels if references.valid is None else np.where(references.valid[index], pixels, 0).astype(np.uint8)
        for index, pixels in enumerate(references.pixels)
    )
    poses = np.column_stack([references.positions, np.zeros(len(references))])
    writer.add_references(images, poses, names=_file_names(references.names), sds=keyframes.sds)
    return writer.finish()


def _file_names(names: tuple[str, ...]) -> list[str]:
    """PNG names without folders, none twice."""
    found: list[str] = []
    for name in names:
        plain = str(PurePosixPath(name).with_suffix("")).replace("/", "_")
        chosen, count = f"{plain}.png", 1
        while chosen in found:
            count += 1
            chosen = f"{plain}_{count}.png"
        found.append(chosen)
    return found


def keyframe_trajectory(panorama_map: PanoramaMap) -> tuple[Trajectory, str]:
    """Poses of the keyframes over time, and a word on the time stamps if they are not those of the images."""
    keyframes = panorama_map.keyframes
    order = np.argsort(keyframes.times, kind="stable")
    times = keyframes.times[order]
    if np.isfinite(times).all() and np.all(np.diff(times) > 0.0):
        return Trajectory(times, keyframes.poses[order]), ""
    count = len(keyframes)
    return (
        Trajectory(np.arange(count, dtype=np.float64), keyframes.poses),
        "keyframes have no times, or share them: stamps in the TUM file are their numbers",
    )

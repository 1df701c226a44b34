"""A data set of many references in rooms that look alike, those of `panoloc benchmark places`, to build a large map of.

    python scripts/many_rooms.py FOLDER [--references 2000] [--apart 1.0] [--columns 360]

Poses are exact. Building the map: `panoloc build-map FOLDER -o rooms.panomap`; what it takes, and that it may be killed, is told in
docs/measurements.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.benchmarks.campus.building import ELEVATION_DEG, geometry
from panoloc_mcl.laboratory.benchmarks.campus.rooms import HEIGHT_M, SIZE_M, rooms
from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.tools.datasets.writer import DatasetWriter

_MARGIN_M = 0.8


def main() -> None:
    """Draw the images and write them with their poses."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--references", type=int, default=2000)
    parser.add_argument("--apart", type=float, default=1.0, help="metres")
    parser.add_argument("--columns", type=int, default=360)
    asked = parser.parse_args()
    x, y = (np.arange(_MARGIN_M, size - _MARGIN_M + 0.1, asked.apart) for size in SIZE_M)
    grid = np.array([(across, up, 0.0) for up in y for across in x])
    shape = geometry(asked.columns)
    every = [(room, at + np.array([*room.corner, 0.0])) for room in rooms(-(-asked.references // len(grid))) for at in grid]
    every = every[: asked.references]
    camera = PanoramaCamera(elevation_deg=ELEVATION_DEG, height_m=HEIGHT_M)
    writer = DatasetWriter(asked.folder, asked.folder.name, camera, "Rooms that look alike", "CC0-1.0")
    writer.add_references((room.panorama(shape, pose) for room, pose in every), np.array([pose for _, pose in every]))
    writer.finish()


if __name__ == "__main__":
    main()

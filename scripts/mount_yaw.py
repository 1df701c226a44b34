#!/usr/bin/env python3
"""What references tell of the mount's yaw with all else of the camera as described: as they are, mirrored, and turned.

A convention of pixels that is off would turn mirrored images the same way; a world that is no floor and walls turns them the other way.
References must be panoramas whose columns run clockwise from the heading.

Usage: mount_yaw.py DATASET [REFERENCES]
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.calibration.adjustment import adjust
from panoloc_mcl.tools.calibration.features import FINE_COLUMNS
from panoloc_mcl.tools.calibration.parameters import parameters_by_references
from panoloc_mcl.tools.calibration.references_scene import ReferencesScene
from panoloc_mcl.tools.datasets import read_dataset

STEPS = (1.0,) * 5


def changed(references: References, folder: Path, *, mirrored: bool, turned: bool) -> References:
    """The same places seen in a mirror, or at any heading."""
    rng, width = np.random.default_rng(0), references.image_size[0]
    poses, files = references.poses.copy(), []
    poses[:, 1:] *= -1.0 if mirrored else 1.0
    for index, file in enumerate(references.files):
        image = read_image(file)
        if mirrored:
            # Column c becomes -c.
            image = np.roll(image[:, ::-1], 1, axis=1)
        if turned:
            columns = int(rng.integers(width))
            image = np.roll(image, columns, axis=1)
            poses[index, 2] += columns * 2.0 * np.pi / width
        files.append(folder / f"{mirrored}_{turned}_{index}.png")
        cv2.imwrite(str(files[-1]), image)
    return replace(references, files=tuple(files), poses=poses)


def main() -> None:
    """Print the table."""
    references = read_dataset(sys.argv[1]).references
    most = int(sys.argv[2]) if len(sys.argv) > 2 else len(references)
    print("| references | looked at | yaw | standard deviation by their scatter |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, mirrored, turned in (("as they are", False, False), ("mirrored", True, False), ("turned", False, True)):
            some = changed(references, Path(folder), mirrored=mirrored, turned=turned)
            parameters = [one for one in parameters_by_references(some.camera, placed=True) if one.name == "yaw"]
            scene = ReferencesScene(some, VotesSettings(), some.camera, most, FINE_COLUMNS)
            found = adjust(some.camera, parameters, scene, schedule=STEPS)
            sd = float(np.sqrt(found.covariance[0, 0]))
            print(f"| {name} | {found.images} | {found.estimates[0].value:.3f}° | {sd:.3f}° |", flush=True)


if __name__ == "__main__":
    main()

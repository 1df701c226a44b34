"""One image of a data set under imperfections of real recordings, as `panoloc corrupt` writes it. Writes a PNG.

    python scripts/show_imperfections.py [--dataset hall] [--sequence noon_00] [--image 5] [--recipes NAME ...] [-o FILE]

Two columns, row by row; the first one is the image as it is.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from panoloc_mcl.laboratory.corruptions import corrupt, parse_recipe
from panoloc_mcl.robot.images import read_image, write_image
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

RECIPES = (
    "clean",
    "people:strong",
    "body:strong",
    "foliage:strong",
    "reflections:strong",
    "flare:strong",
    "mount_tilt:strong",
    "sensor:strong",
    "jpeg:strong",
    "motion_blur:strong",
    "everything:mild",
    "everything:strong",
)


def main(argv: list[str] | None = None) -> int:
    """Corrupt one image by each recipe, write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall")
    parser.add_argument("--sequence", default="noon_00")
    parser.add_argument("--image", type=int, default=5)
    parser.add_argument("--recipes", nargs="+", default=list(RECIPES))
    parser.add_argument("-o", "--output", default="imperfections.png")
    arguments = parser.parse_args(argv)
    dataset = read_dataset(resolve_dataset(arguments.dataset))
    views = []
    with tempfile.TemporaryDirectory() as folder:
        for number, recipe in enumerate(arguments.recipes):
            path = corrupt(dataset, parse_recipe(recipe), 0, Path(folder) / str(number), [arguments.sequence])
            image = read_image(read_dataset(path).sequences[arguments.sequence].files[arguments.image])
            view = np.full((image.shape[0] + 16, image.shape[1] + 6), 255, dtype=np.uint8)
            view[16:, 3:-3] = image
            cv2.putText(view, recipe, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 0, 1, cv2.LINE_AA)
            views.append(view)
    blank = np.full_like(views[0], 255)
    views += [blank] * (len(views) % 2)
    write_image(Path(arguments.output), np.vstack([np.hstack(views[row : row + 2]) for row in range(0, len(views), 2)]))
    print(arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())

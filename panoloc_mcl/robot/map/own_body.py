"""The robot in the images that a map is made of, found where nobody painted a mask.

A body that is the same in all images agrees with every place at one heading, so it votes for them all. What `find_body` finds is used
here without anybody looking at it: only parts that can be nothing else are left out, of the map and of later images of its camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import AnyCamera, Mask
from panoloc_mcl.robot.camera.body import MOST_IMAGES, find_body, grey_levels, lower_rim, ring_of
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.images import ImageSource, read_image

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

# Images needed, taken at places so far from each other, or looking so far elsewhere: those of a robot that stands are one.
_FEWEST, _APART_M, _APART_RAD = 12, 0.5, np.radians(30.0)
# Pixels of an image that are looked at; larger ones are made smaller.
_MOST_PIXELS = 100_000
# Of the pixels: less is no body that matters, and a robot that hides more is not believed.
_LEAST_HIDDEN, _MOST_HIDDEN = 5e-3, 0.5


def with_found_mask(
    camera: AnyCamera, image_size: tuple[int, int], files: Sequence[ImageSource], poses: Float64
) -> tuple[AnyCamera, tuple[str, ...]]:
    """The camera with the robot left out of its sight, and a note of it; the camera itself if it has a mask, or nothing is found.

    Parameters
    ----------
    camera : AnyCamera
    image_size : (int, int)
        Width and height of its images, pixels.
    files : sequence of Path or StoredImage
        Its images.
    poses : float64 (n, 3)
        Where they were taken, as far as that is known: metres and radians.
    """
    if camera.mask is not None:
        return camera, ()
    images = _small_images([files[index] for index in _some(poses)], image_size)
    if len(images) < _FEWEST:
        return camera, ()
    height, width = images[0].shape
    seen = ring_of(camera, image_size)
    small_seen = None if seen is None else _resized(seen, (width, height))
    found = find_body(images, small_seen)
    rim = (
        cv2.resize(lower_rim(camera, image_size, seen).astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0.0
    )
    world = found.without_doubt(rim)
    hidden = 1.0 - float(world.mean())
    if not _LEAST_HIDDEN <= hidden <= _MOST_HIDDEN:
        return camera, ()
    note = f"found the robot's body in its images: {100.0 * hidden:.0f} % of the pixels; a mask in dataset.yaml overrules it"
    return camera.model_copy(update={"mask": Mask(_resized(world, image_size))}), (note,)


def _some(poses: Float64) -> Int64:
    """Images that are apart from each other, at most as many as are looked at, evenly over all."""
    apart: list[int] = []
    for index, pose in enumerate(poses):
        near = np.hypot(*(poses[apart, :2] - pose[:2]).T) < _APART_M
        if not np.any(near & (np.abs(angle_difference(poses[apart, 2], pose[2])) < _APART_RAD)):
            apart.append(index)
    chosen = np.unique(np.linspace(0, len(apart) - 1, min(len(apart), MOST_IMAGES)).round().astype(np.int64))
    return np.array(apart, dtype=np.int64)[chosen]


def _small_images(files: Sequence[ImageSource], image_size: tuple[int, int]) -> list[Float32]:
    """Grey levels; damaged images are for whoever reads the map's panoramas to name."""
    width, height = image_size
    shrink = int(np.ceil(np.sqrt(width * height / _MOST_PIXELS)))
    size = max(1, width // shrink), max(1, height // shrink)
    images = []
    for file in files:
        try:
            grey = grey_levels(read_image(file))
        except ImageError:
            continue
        if grey.shape == (height, width):
            images.append(grey if shrink == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA))
    return images


def _resized(mask: Bool, size: tuple[int, int]) -> Bool:
    if mask.shape == size[::-1]:
        return mask
    # Half a pixel that is not the world is none of it.
    levels = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(levels > 0.99)

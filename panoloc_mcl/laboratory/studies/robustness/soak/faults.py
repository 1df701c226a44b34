"""What may go wrong with an image, its stamp and odometry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[Any]


def _half(image: Image, rng: np.random.Generator) -> Image:
    out = image.copy()
    begin = int(rng.integers(image.shape[1] // 2))
    out[:, begin : begin + image.shape[1] // 2] = 0
    return out


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    bad = rng.random(image.shape[:2]) < 0.4
    out = image.copy()
    out[bad] = rng.integers(0, 256, (int(bad.sum()), *image.shape[2:]))
    return out


def _foreign(image: Image, rng: np.random.Generator) -> Image:
    """Of nowhere: blocks of the image in another order, upside down."""
    blocks = np.array_split(image[::-1], 9, axis=1)
    return np.concatenate([blocks[index] for index in rng.permutation(9)], axis=1)


def _not_numbers(image: Image, rng: np.random.Generator) -> Image:
    out = image.astype(np.float32)
    out[rng.random(out.shape) < 0.5] = np.nan
    return out


#: Faults of images by name.
IMAGE_FAULTS: dict[str, Callable[[Image, np.random.Generator], Image]] = {
    "black image": lambda image, rng: np.zeros_like(image),
    "saturated image": lambda image, rng: np.full_like(image, 255),
    "half of it black": _half,
    "40 % noise": _noisy,
    "image of nowhere": _foreign,
    "wrong size": lambda image, rng: np.ascontiguousarray(image[:-1, :-3]),
    "no numbers": _not_numbers,
}
STAMP_FAULTS = ("stamp twice", "stamp not finite", "stamp 60 s ahead", "stamp 0.5 s late", "image missing", "images reordered")
ODOMETRY_FAULTS = (
    "odometry not finite",
    "odometry infinite",
    "odometry jumps",
    "odometry frozen",
    "odometry reset",
    "odometry missing",
)
FROZEN, KIDNAP, CLOCK = "image frozen", "carried off", "clock jumps by 500 s"

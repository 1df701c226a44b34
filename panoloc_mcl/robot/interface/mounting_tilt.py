"""How the camera leans on its mount, against the references: learnt over images, as far as it stays.

Every image tells how the camera leant when it was taken. What all have in common is the mount; what changes from one to the next is
bumps and slopes. Both are unknown, mean and variance of one normal distribution, and learnt together (normal-inverse-gamma, as in
Murphy, "Machine Learning", section 4.6): where the tilt changes, the variance stays large and nothing is claimed of the mean.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

# Before any image: upright, give or take so much, of which one is as sure as of a few images; radians.
_SD, _IMAGES_OF_MEAN, _IMAGES_OF_SD = math.radians(2.0), 0.1, 1.0
# Images nearer to each other err alike, metres.
_LEAST_WAY_M = 0.1
# A mount is known where tilts vary by less than this, radians, and over so many images.
_STEADY, _FEWEST = math.radians(0.5), 10
# It leans where it does so by more than this, radians, and by so many standard deviations of the mean.
_LEANS, _SURE = math.radians(0.5), 3.0


@dataclass(frozen=True)
class MountingTilt:
    """What images so far tell of the mount.

    Parameters
    ----------
    images : int
        That told.
    pitch, roll : float
        Of the mount: about the robot's axes to the left (positive: nose down) and ahead (positive: right side down), radians.
    squares : float
        Sum of squared deviations of both, square radians.
    way : float
        Driven since the last image that told, metres.
    """

    images: int = 0
    pitch: float = 0.0
    roll: float = 0.0
    squares: float = 2.0 * _IMAGES_OF_SD * _SD**2
    way: float = math.inf

    def moved(self, way: float) -> Self:
        """After a way, metres."""
        return type(self)(self.images, self.pitch, self.roll, self.squares, self.way + way)

    def seen(self, tilt: Float64) -> Self:
        """After an image with a tilt (2,): pitch and roll, radians. One where the robot has hardly moved tells nothing."""
        if self.way < _LEAST_WAY_M:
            return self
        before = self.images + _IMAGES_OF_MEAN
        off = tilt - np.array([self.pitch, self.roll])
        pitch, roll = (np.array([self.pitch, self.roll]) + off / (before + 1.0)).tolist()
        squares = self.squares + before / (before + 1.0) * float(off @ off)
        return type(self)(self.images + 1, pitch, roll, squares, 0.0)

    @property
    def sd(self) -> float:
        """By how much tilts vary from image to image, each of pitch and roll: radians."""
        return math.sqrt(self.squares / (2.0 * (self.images + _IMAGES_OF_SD)))

    @property
    def known(self) -> bool:
        """Whether the tilt stays, so that it is the mount's."""
        return self.images >= _FEWEST and self.sd < _STEADY

    @property
    def leans(self) -> bool:
        """Whether the mount is known to lean against that of the references."""
        size = math.hypot(self.pitch, self.roll)
        return self.known and size > max(_LEANS, _SURE * self.sd / math.sqrt(self.images))

    def __str__(self) -> str:
        if not self.known:
            return "tilt of the mount not known"
        return f"mount leans by {math.degrees(self.pitch):.2f} degrees forward and {math.degrees(self.roll):.2f} to the right"

    def array(self) -> Float64:
        """All of it, float64 (5,)."""
        return np.array([self.images, self.pitch, self.roll, self.squares, self.way])

    @classmethod
    def of_array(cls, values: Float64) -> Self:
        """What `array` gave.

        Raises
        ------
        ValueError
            Another shape, or values that cannot be.
        """
        if values.shape != (5,) or np.isnan(values).any() or values[0] < 0.0 or values[3] <= 0.0 or values[4] < 0.0:
            raise ValueError("tilt of the mount of another form")
        images, pitch, roll, squares, way = values.tolist()
        return cls(int(images), pitch, roll, squares, way)

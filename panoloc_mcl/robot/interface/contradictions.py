"""How far floor and walls contradict each other about the poses of a drive: more than in the map's own images, and the camera is wrong.

A centre or elevations that are off displace the pose of every image, but not every image shows it: where walls are near or the floor
has no texture, its rows agree on a wrong pose. So what a quarter of the images on the way shows is believed of all. People, blur and
tilt make some images contradict themselves, too, but fewer: of those, the quantile says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

# Images nearer to each other show the same, metres.
_LEAST_WAY_M = 0.1
# So many images are remembered, and this share of them may be less contradictory than what is believed of all. Tried on three drives of
# the rendered hall and three of the office, as described and with centre and elevations off: those as described are as before.
_REMEMBERED, _QUANTILE = 30, 0.75
# Fewer do not tell that the camera is wrong.
_FEWEST = 8


@dataclass(frozen=True)
class Contradictions:
    """What images so far tell of the camera.

    Parameters
    ----------
    excesses : tuple of float
        Of the last images that told (see `PoseMeasurement.excess`), the newest at the end.
    way : float
        Driven since the last of them, metres.
    """

    excesses: tuple[float, ...] = ()
    way: float = np.inf

    def moved(self, way: float) -> Self:
        """After a way, metres."""
        return type(self)(self.excesses, self.way + way)

    def seen(self, excess: float) -> Self:
        """After an image. One where the robot has hardly moved tells nothing new."""
        if self.way < _LEAST_WAY_M:
            return self
        return type(self)((*self.excesses, excess)[-_REMEMBERED:], 0.0)

    @property
    def usual(self) -> float:
        """The excess that a quarter of the images reach; 0 where hardly any contradicts itself, or none has been seen."""
        if not self.excesses:
            return 0.0
        # Rounded down: of two images both have to tell, of four the second.
        return sorted(self.excesses)[int(_QUANTILE * (len(self.excesses) - 1))]

    @property
    def tell(self) -> bool:
        """Whether enough images say that the camera is not as it is described."""
        return len(self.excesses) >= _FEWEST and self.usual > 0.0

    def array(self) -> Float64:
        """All of it, float64 (1 + images,)."""
        return np.array([self.way, *self.excesses])

    @classmethod
    def of_array(cls, values: Sequence[float] | Float64) -> Self:
        """What `array` gave.

        Raises
        ------
        ValueError
            Another shape, or values that cannot be.
        """
        numbers = np.asarray(values, dtype=np.float64)
        if numbers.ndim != 1 or not 1 <= len(numbers) <= 1 + _REMEMBERED or not (numbers >= 0.0).all():
            raise ValueError("contradictions of another form")
        way, *excesses = numbers.tolist()
        return cls(tuple(excesses), way)

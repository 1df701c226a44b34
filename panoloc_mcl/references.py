"""The reference panoramas of a map: brought to heading 0, all of one size, with their positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.camera import Panorama, PanoramaGeometry


@dataclass(frozen=True, eq=False)
class ReferencePanoramas:
    """Reference panoramas at heading 0.

    Parameters
    ----------
    pixels : uint8 (n, rows, columns)
        Grey levels.
    valid : bool (rows, columns), or None
        Pixels that the reference camera sees, where it does not see all.
    positions : float64 (n, 2)
        Metres, map frame.
    names : tuple of str
        File names, for messages.
    geometry : PanoramaGeometry
    camera_height_m : float or None
        Of the camera above the floor.
    """

    pixels: NDArray[np.uint8]
    valid: NDArray[np.bool_] | None
    positions: NDArray[np.float64]
    names: tuple[str, ...]
    geometry: PanoramaGeometry
    camera_height_m: float | None

    def __len__(self) -> int:
        return len(self.pixels)

    def panorama(self, index: int) -> Panorama:
        """One reference as a panorama."""
        return Panorama(self.pixels[index].astype(np.float32), self.valid)

"""Views from where no camera stood: the walls that the references see, brought to another place, and their images warped there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.camera import Panorama, PanoramaGeometry
from panoloc_mcl.eigenspace.gradients import pad_circular
from panoloc_mcl.kernels.warping import move_profile, warp_table
from panoloc_mcl.references import ReferencePanoramas

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

# cv2.remap interpolates between neighbouring columns only.
MARGIN = 4


@dataclass(frozen=True, eq=False)
class FloorRays:
    """Rows of a panorama as rays.

    Parameters
    ----------
    tangents : float64 (rows,)
        Of the elevation.
    floor : float64 (rows,)
        Distance at which the row meets the floor, metres; infinity above the horizon.
    top, row_step : float
        Elevation of the upper edge of the first row, and of one row, radians.
    """

    tangents: Float64
    floor: Float64
    top: float
    row_step: float

    @classmethod
    def of(cls, geometry: PanoramaGeometry, camera_height_m: float) -> FloorRays:
        """Rays of a panorama taken at a height above the floor."""
        tangents = np.tan(geometry.elevation_of_row(np.arange(geometry.height)))
        floor = np.full(len(tangents), np.inf)
        below = tangents < -1e-6
        floor[below] = camera_height_m / -tangents[below]
        span = np.radians(geometry.elevation_top_deg - geometry.elevation_bottom_deg)
        return cls(tangents, floor, float(np.radians(geometry.elevation_top_deg)), float(span / geometry.height))


class ViewSynthesizer:
    """Warps references into views at other places.

    Parameters
    ----------
    references : ReferencePanoramas
    profiles : float64 (n, columns)
        Distance of the wall around every reference, metres (see `sweep_profiles`).
    camera_height_m : float
    """

    def __init__(self, references: ReferencePanoramas, profiles: Float64, camera_height_m: float) -> None:
        self.references = references
        self.profiles = profiles
        self.rays = FloorRays.of(references.geometry, camera_height_m)

    @cached_property
    def _padded(self) -> Float32:
        """References as float32, continued across the seam: (n, rows, columns + 2 margins)."""
        return np.stack([pad_circular(image.astype(np.float32), MARGIN) for image in self.references.pixels])

    def of(self, indices: NDArray[np.int64]) -> ViewSynthesizer:
        """A synthesiser that has some of the references only."""
        references = self.references
        chosen = replace(
            references,
            pixels=references.pixels[indices],
            positions=references.positions[indices],
            names=tuple(references.names[index] for index in indices),
        )
        some = ViewSynthesizer(chosen, self.profiles[indices], 1.0)
        some.rays = self.rays
        return some

    def profile_at(self, source: int, position: Float64) -> Float64:
        """Wall profile of a reference as seen from another position, float64 (columns,), metres."""
        dx, dy = position - self.references.positions[source]
        return move_profile(self.profiles[source], float(dx), float(dy))

    def table(self, source: int, position: Float64, profile: Float64, stride: int = 1) -> tuple[Float32, Float32]:
        """Where the pixels of a view at a position lie in a reference, for ``cv2.remap`` on images padded by `MARGIN` columns.

        Parameters
        ----------
        source : int
            Index of the reference.
        position : float64 (2,)
            Metres, map frame.
        profile : float64 (columns,)
            Wall distances as seen from there.
        stride : int
            Every how many rows and columns; must divide the columns.

        Returns
        -------
        map_x, map_y : float32 (ceil(rows / stride), columns / stride)
        """
        dx, dy = position - self.references.positions[source]
        rays = self.rays
        return warp_table(
            np.ascontiguousarray(profile[::stride]),
            np.ascontiguousarray(rays.tangents[::stride]),
            np.ascontiguousarray(rays.floor[::stride]),
            float(dx),
            float(dy),
            rays.top,
            rays.row_step,
            len(profile),
            MARGIN,
        )

    def view(self, source: int, position: Float64, profile: Float64) -> Panorama:
        """The image of a reference as seen from another position, heading 0 (parameters as in `table`)."""
        map_x, map_y = self.table(source, position, profile)
        pixels = cv2.remap(self._padded[source], map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        rows = pixels.shape[0]
        seen = (map_y > -0.5) & (map_y < rows - 0.5)
        if self.references.valid is not None:
            valid = pad_circular(self.references.valid.astype(np.float32), MARGIN)
            seen &= cv2.remap(valid, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) > 0.99
        if seen.all():
            return Panorama(pixels, None)
        pixels *= seen
        return Panorama(pixels, seen)

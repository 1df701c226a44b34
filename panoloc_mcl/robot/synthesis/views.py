"""Views from where no camera stood: the walls that the references see, brought to another place, and their images warped there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.eigenspace.gradients import pad_circular
from panoloc_mcl.robot.kernels.warping import move_profile, warp_table
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.synthesis.source_errors import NONE, SourceErrors

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Bool = NDArray[np.bool_]

# What a pose read off views of one reference errs by, however sure its own is; metres. Of pairs of rendered references 1 m apart.
_VIEW_SD_M = 0.005
# cv2.remap interpolates between neighbouring columns only.
MARGIN = 4
_KEPT_IMAGES = 64
_NOWHERE_M = 1e9


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
    alone : bool (n,), optional
        References that no neighbour fits: views elsewhere are not made from them. None by default.

    Attributes
    ----------
    errors : SourceErrors
        What poses read off the views err by because of the references; nothing until it is learnt.
    """

    def __init__(
        self, references: ReferencePanoramas, profiles: Float64, camera_height_m: float, alone: Bool | None = None
    ) -> None:
        self.references = references
        self.profiles = profiles
        self.camera_height_m = camera_height_m
        self.alone = np.zeros(len(references), dtype=np.bool_) if alone is None else alone
        self.errors: SourceErrors = NONE
        self.rays = FloorRays.of(references.geometry, camera_height_m)
        # Of a large map only those at hand; whoever goes from place to place needs the same ones again.
        # Not of a method, which would keep the synthesiser itself until the garbage is collected.
        self._padded = lru_cache(maxsize=_KEPT_IMAGES)(partial(_padded, references))
        self._padded_valid = lru_cache(maxsize=_KEPT_IMAGES)(partial(_padded_valid, references))

    def __reduce__(self) -> tuple[Any, ...]:
        # Pickled without what it keeps.
        return ViewSynthesizer, (self.references, self.profiles, self.camera_height_m, self.alone), {"errors": self.errors}

    @cached_property
    def _sources(self) -> NDArray[np.int64]:
        return np.flatnonzero(~self.alone)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.references.positions[self._sources])

    def sources_around(self, position: Float64, count: int) -> tuple[Float64, NDArray[np.int64]]:
        """Distances and indices of the nearest references that views can be made from."""
        distances, found = self._tree.query(position, k=min(count, len(self._sources)))
        return np.atleast_1d(distances), self._sources[np.atleast_1d(found)]

    @cached_property
    def trust(self) -> Float64:
        """How much every reference counts as a source, (n,): 1 where its pose is as sure as usual, more or less where not."""
        sds = self.references.sds
        if sds is None:
            return np.ones(len(self.references))
        variances = np.square(sds[:, 0])
        usual = float(np.median(variances[self._sources])) if len(self._sources) else 0.0
        return np.asarray((_VIEW_SD_M**2 + usual) / (_VIEW_SD_M**2 + variances))

    def errors_at(self, weights: Float64, sources: NDArray[np.int64], position: Float64) -> tuple[Float64, Float64]:
        """Covariances of what the map errs by in a pose that is read off views of sources, float64 (3, 3), metres and radians.

        What references tell of each other (`errors`), which is of the place; and what their poses are known to err by together, as
        after mending, which is of the frame and does not average out.
        """
        of_map = self.errors.of_sources(weights, position - self.references.positions[sources])
        if self.references.sds is None:
            return of_map, np.zeros((3, 3))
        x, heading = weights @ np.square(self.references.sds[sources])
        return of_map, np.diag([x, x, heading])

    def of(self, indices: NDArray[np.int64]) -> ViewSynthesizer:
        """A synthesiser that has some of the references only."""
        return ViewSynthesizer(self.references.of(indices), self.profiles[indices], self.camera_height_m, self.alone[indices])

    def without(self, reference: int) -> ViewSynthesizer:
        """A synthesiser as though a reference had never been taken: arrays are shared, and it stands where nobody looks."""
        positions, alone = self.references.positions.copy(), self.alone.copy()
        positions[reference], alone[reference] = _NOWHERE_M, True
        return ViewSynthesizer(replace(self.references, positions=positions), self.profiles, self.camera_height_m, alone)

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
        pixels = cv2.remap(self._padded(source), map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        rows = pixels.shape[0]
        seen = (map_y > -0.5) & (map_y < rows - 0.5)
        if self.references.valid is not None:
            seen &= (
                cv2.remap(self._padded_valid(source), map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) > 0.99
            )
        if seen.all():
            return Panorama(pixels, None)
        pixels *= seen
        return Panorama(pixels, seen)


def _padded(references: ReferencePanoramas, source: int) -> Float32:
    """A reference as float32, continued across the seam: (rows, columns + 2 margins)."""
    return pad_circular(references.pixels[source].astype(np.float32), MARGIN)


def _padded_valid(references: ReferencePanoramas, source: int) -> Float32:
    """Where a reference shows the world, 1 or 0, continued across the seam like its pixels."""
    assert references.valid is not None
    return pad_circular(references.valid[source].astype(np.float32), MARGIN)

"""The canonical panorama: which way every pixel of an unwrapped image looks.

The centre of column 0 looks along the robot's heading and the columns run clockwise (seen from above) over the full circle.
Row 0 is the top row. Elevation is linear in angle: the top row's upper edge lies at the top elevation and the bottom row's
lower edge at the bottom one, so every row covers the same share of the field. Azimuths are positive to the left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.errors import CameraError
from panoloc_mcl.robot.geometry import wrap_angle

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PanoramaGeometry:
    """Size and vertical field of a canonical panorama.

    Parameters
    ----------
    width : int
        Columns over 360 degrees, at least 4.
    height : int
        Rows, at least 2.
    elevation_bottom_deg, elevation_top_deg : float
        Elevation of the lower edge of the bottom row and of the upper edge of the top row, degrees above the horizon.

    Raises
    ------
    CameraError
        Too few pixels, or elevations that are not -90 <= bottom < top <= 90.
    """

    width: int
    height: int
    elevation_bottom_deg: float
    elevation_top_deg: float

    def __post_init__(self) -> None:
        faults = []
        if self.width < 4 or self.height < 2:
            faults.append(f"panorama size = {self.width} x {self.height}: must be at least 4 columns and 2 rows")
        bottom, top = self.elevation_bottom_deg, self.elevation_top_deg
        if not (math.isfinite(bottom) and math.isfinite(top) and -90.0 <= bottom < top <= 90.0):
            faults.append(f"elevation_deg = [{bottom}, {top}]: must be [bottom, top] with -90 <= bottom < top <= 90")
        if faults:
            raise CameraError(faults)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as NumPy counts them."""
        return self.height, self.width

    @property
    def elevation_deg(self) -> tuple[float, float]:
        """Elevation of the lower and of the upper edge, degrees."""
        return self.elevation_bottom_deg, self.elevation_top_deg

    def of_rows(self, first: int, stop: int) -> PanoramaGeometry:
        """The part between two rows, the second of which no longer belongs to it."""
        step = (self.elevation_top_deg - self.elevation_bottom_deg) / self.height
        top, bottom = self.elevation_top_deg - first * step, self.elevation_top_deg - stop * step
        return PanoramaGeometry(self.width, stop - first, bottom, top)

    def azimuth_of_column(self, column: ArrayLike) -> FloatArray:
        """Azimuth that columns look along, radians in ``[-pi, pi)``, left positive; fractions and wraps allowed."""
        return wrap_angle(-2.0 * np.pi * np.asarray(column, dtype=np.float64) / self.width)

    def column_of_azimuth(self, azimuth: ArrayLike) -> FloatArray:
        """Column (float, in ``[0, width)``) that looks along azimuths in radians."""
        column = np.mod(-np.asarray(azimuth, dtype=np.float64) * self.width / (2.0 * np.pi), self.width)
        # np.mod may round up to the modulus itself, which is column 0.
        return np.where(column >= self.width, 0.0, column)

    def elevation_of_row(self, row: ArrayLike) -> FloatArray:
        """Elevation of row centres, radians above the horizon; fractions allowed, rows outside extrapolate."""
        top, bottom = math.radians(self.elevation_top_deg), math.radians(self.elevation_bottom_deg)
        return np.asarray(top + (np.asarray(row, dtype=np.float64) + 0.5) * ((bottom - top) / self.height))

    def row_of_elevation(self, elevation: ArrayLike) -> FloatArray:
        """Row (float, may lie outside the image) that looks at elevations in radians."""
        top, bottom = math.radians(self.elevation_top_deg), math.radians(self.elevation_bottom_deg)
        return np.asarray((np.asarray(elevation, dtype=np.float64) - top) * (self.height / (bottom - top)) - 0.5)


@dataclass(frozen=True, eq=False)
class Panorama:
    """A canonical panorama.

    Parameters
    ----------
    pixels : ndarray of float32, shape (height, width)
        Grey levels 0..255; 0 where not valid.
    valid : ndarray of bool, shape (height, width), or None
        Which pixels the camera saw; None when it saw them all.
    """

    pixels: NDArray[np.float32]
    valid: NDArray[np.bool_] | None = None


def shifted(pixels: NDArray[Any], columns: float) -> NDArray[np.float64]:
    """Rows of panoramas, moved to the right around the circle by any number of columns.

    By their spectrum: a kernel of a few columns moves fine texture by another amount than coarse, and a panorama with it. One of 360
    columns that a cubic kernel turned by 0.15 degrees was read 0.027 degrees off.

    Parameters
    ----------
    pixels : (..., columns)
    columns : float
    """
    width = pixels.shape[-1]
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(width) * columns)
    return np.asarray(np.fft.irfft(np.fft.rfft(pixels, axis=-1) * turn, width, axis=-1))

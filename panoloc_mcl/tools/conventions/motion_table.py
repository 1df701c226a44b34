"""What pairs of images say of the motion between them: agreement over turns and directions of travel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.robot.camera import Camera, PanoramaGeometry, Unwrapper, geometry_of
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.errors import CameraError, ImageError
from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.robot.settings.observation import VotesSettings

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]

# Three degrees a column, six a row: conventions err by far more, and a pair takes milliseconds.
COLUMNS = 120
_ROWS_EVERY = 2
# Directions of travel that are tried.
BEARINGS = 12
# The world is taken for a floor and a round wall so far away, metres; of these the one that fits a pair best counts.
_WALLS_M = (2.0, 6.0)
_USUAL_HEIGHT_M = 0.6


@dataclass(frozen=True, eq=False)
class MotionTable:
    """Agreement of the second image of each pair with the first one as seen from elsewhere.

    Parameters
    ----------
    agreement : float64 (pairs, 1 or 2, bearings, columns)
        Cosine of both images' gradient orientations. The first image is seen from where it moved to along a bearing, in its own
        frame, by as much as is written for the pair; the second is turned back by so many columns. Upright, and perhaps upside down.
    """

    agreement: Float64

    def __len__(self) -> int:
        return len(self.agreement)

    def at(self, bearings: Float64, turns: Float64, *, mirrored: bool = False, flipped: bool = False) -> Float64:
        """Agreement of each pair for a direction of travel and a turn, radians (pairs,), counter-clockwise.

        ``mirrored``, ``flipped``: as though left and right, up and down of the images were changed over.
        """
        table = self.agreement[:, int(flipped)]
        sign = -1.0 if mirrored else 1.0
        place = sign * bearings / (2.0 * np.pi) * BEARINGS
        column = np.rint(sign * turns / (2.0 * np.pi) * COLUMNS).astype(np.int64)
        low = np.floor(place).astype(np.int64)
        share = place - low
        rows = np.arange(len(table))
        # A column to either side: poses are not exact.
        near = [(column + step) % COLUMNS for step in (-1, 0, 1)]
        one, other = (np.max([table[rows, (low + step) % BEARINGS, some] for some in near], axis=0) for step in (0, 1))
        return np.asarray((1.0 - share) * one + share * other)

    def turns(self) -> tuple[Float64, Float64]:
        """How the camera turned between the images of each pair, radians (pairs,), and how far that stands out from other turns."""
        best = self.agreement[:, 0].max(axis=1)
        peak = best.argmax(axis=1)
        offsets = (np.arange(COLUMNS)[None, :] - peak[:, None] + COLUMNS // 2) % COLUMNS - COLUMNS // 2
        elsewhere = np.where(np.abs(offsets) > COLUMNS // 12, best, -np.inf).max(axis=1)
        around = np.take_along_axis(best, (peak[:, None] + np.array([-1, 0, 1])) % COLUMNS, axis=1)
        curve = around[:, 0] - 2.0 * around[:, 1] + around[:, 2]
        shift = np.where(curve < -1e-9, 0.5 * (around[:, 0] - around[:, 2]) / np.minimum(curve, -1e-9), 0.0)
        turned = 2.0 * np.pi * (peak + np.clip(shift, -0.5, 0.5)) / COLUMNS
        return np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi, best.max(axis=1) - elsewhere


class Views:
    """Small panoramas of some images in the frame of the camera, and how they look from elsewhere.

    Parameters
    ----------
    camera : Camera
    image_size : (int, int)
    files : sequence of image sources
    """

    def __init__(self, camera: Camera, image_size: tuple[int, int], files: Sequence[ImageSource]) -> None:
        full = geometry_of(camera, image_size)
        rows = max(8, round(full.height * COLUMNS / full.width))
        self.geometry = PanoramaGeometry(COLUMNS, rows, full.elevation_bottom_deg, full.elevation_top_deg)
        self.height_m = camera.height_m or _USUAL_HEIGHT_M
        self._unwrap = Unwrapper(camera, image_size, self.geometry)
        self._files = files
        self._kept: dict[int, Float32] = {}
        self._tables: dict[tuple[float, float, float], tuple[Float32, Float32]] = {}

    def features(self, index: int) -> Float32 | None:
        """Gradient orientations of an image, real and imaginary part, float32 (rows, columns, 2); None if it cannot be used."""
        if index not in self._kept:
            try:
                z, _ = orientations(self._unwrap(read_image(self._files[index])), VotesSettings())
            except (ImageError, CameraError):
                return None
            self._kept[index] = np.stack([z.real, z.imag], axis=-1).astype(np.float32)
        return self._kept[index]

    def use_height(self, height_m: float) -> None:
        """Take the camera to be so high above the floor, metres."""
        self.height_m, self._tables = height_m, {}

    def usable(self, pairs: Sequence[tuple[int, int]]) -> list[int]:
        """Numbers of the pairs whose images can both be used."""
        return [number for number, pair in enumerate(pairs) if all(self.features(index) is not None for index in pair)]

    def table(self, pairs: Sequence[tuple[int, int]], distances: Float64, *, flips: bool = False) -> MotionTable:
        """The agreement table of pairs of usable images that were taken so far apart, metres.

        ``flips``: look at them upside down, too, which takes twice the time.
        """
        out = np.full((len(pairs), 1 + flips, BEARINGS, COLUMNS), -1.0)
        bearings = 2.0 * np.pi * np.arange(BEARINGS) / BEARINGS
        for number, distance in enumerate(distances.tolist()):
            for flip in range(1 + flips):
                for bearing, azimuth in enumerate(bearings.tolist()):
                    out[number, flip, bearing] = self._turned(pairs[number], distance, azimuth, bool(flip))
        return MotionTable(out)

    def along(self, pairs: Sequence[tuple[int, int]], moved: Float64, scale: float = 1.0) -> Float64:
        """Agreement of each pair for the motion that is written, (pairs, 3), its way taken so many times as long: float64 (pairs,)."""
        out = np.empty(len(pairs))
        for number, (x, y, turn) in enumerate(moved.tolist()):
            turned = self._turned(pairs[number], math.hypot(x, y) * scale, math.atan2(y, x), False)
            column = round(turn / (2.0 * math.pi) * COLUMNS)
            out[number] = max(turned[(column + step) % COLUMNS] for step in (-1, 0, 1))
        return out

    def _turned(self, pair: tuple[int, int], distance: float, azimuth: float, flip: bool) -> Float64:
        """Agreement for every turn of the second image, as though the first one had been taken off to an azimuth."""
        one, other = (self.features(index) for index in pair)
        assert one is not None
        assert other is not None
        if flip:
            one, other = _upside_down(one), _upside_down(other)
        second = _complex(other[::_ROWS_EVERY])
        spectrum = fft.fft(second, axis=1).conj()
        norm = float(np.linalg.norm(second))
        best = np.full(COLUMNS, -1.0)
        for wall in _WALLS_M:
            warp = self._moved(round(distance, 2), round(azimuth, 2), wall)
            view = _complex(cv2.remap(one, *warp, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT))
            common = fft.ifft((fft.fft(view, axis=1) * spectrum).sum(axis=0)).real
            # Turned left by k columns, the second image shows k columns further right what the first one shows.
            best = np.maximum(best, np.roll(common[::-1], 1) / max(norm * float(np.linalg.norm(view)), 1e-9))
        return best

    def _moved(self, distance: float, azimuth: float, wall: float) -> tuple[Float32, Float32]:
        """Where in an image lies what is seen from a place off to an azimuth: columns and rows, for `cv2.remap`."""
        key = (distance, azimuth, wall)
        if key not in self._tables:
            self._tables[key] = self._tabulated(distance, azimuth, max(wall, 1.5 * distance))
        return self._tables[key]

    def _tabulated(self, distance: float, bearing: float, wall: float) -> tuple[Float32, Float32]:
        rows = self.geometry.height
        top, bottom = self.geometry.elevation_top_deg, self.geometry.elevation_bottom_deg
        step = math.radians(top - bottom) / rows
        elevation = (math.radians(top) - step * (np.arange(0, rows, _ROWS_EVERY) + 0.5))[:, None]
        azimuth = (-2.0 * np.pi * np.arange(COLUMNS) / COLUMNS)[None, :]
        x, y = distance * math.cos(bearing), distance * math.sin(bearing)
        along = x * np.cos(azimuth) + y * np.sin(azimuth)
        away = np.sqrt(along**2 - distance**2 + wall**2) - along
        slope = np.tan(np.clip(elevation, -1.5, 1.5))
        away = np.where(slope < 0.0, np.minimum(away, self.height_m / np.maximum(-slope, 1e-6)), away)
        px, py = x + away * np.cos(azimuth), y + away * np.sin(azimuth)
        source = np.arctan2(away * slope, np.maximum(np.hypot(px, py), 1e-6))
        column = np.mod(-np.arctan2(py, px) / (2.0 * np.pi) * COLUMNS, COLUMNS)
        row = (math.radians(top) - source) / step - 0.5
        # The seam: the last half column is read as the first one.
        return np.minimum(column, COLUMNS - 1.0).astype(np.float32), row.astype(np.float32)


def _complex(planes: Float32) -> Complex64:
    return np.ascontiguousarray(planes).view(np.complex64)[..., 0]


def _upside_down(planes: Float32) -> Float32:
    """Features of the image with its rows in reverse: gradients along them change their sign, so doubled angles theirs."""
    return np.ascontiguousarray(planes[::-1] * np.array([1.0, -1.0], dtype=np.float32))

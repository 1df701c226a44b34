"""The pose of one image to millimetres: Gauss-Newton on the view synthesised around the best place.

Lucas & Kanade (1981) with a synthesised view in place of an image patch: every step takes the view at the pose reached so far from
the nearest references, what a small step of position, heading and tilt would change in it, and solves for the step that explains the
difference to the image. The first steps compare smoothed features on a coarse grid, which reach far and cost little; there the
references' features are warped as they are. The last steps warp the images and compute the features of the result.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.config.model import VotesSettings
from panoloc_mcl.eigenspace.gradients import orientations, pad_circular
from panoloc_mcl.geometry import wrap_angle
from panoloc_mcl.kernels.warping import normal_equations
from panoloc_mcl.measurement import PoseMeasurement
from panoloc_mcl.synthesis.views import MARGIN, ViewSynthesizer

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]


class Scale(NamedTuple):
    """A resolution at which features are compared: every ``stride`` pixels, smoothed with a standard deviation in pixels."""

    stride: int
    sigma: float


_COARSE_STEPS = (Scale(4, 5.0), Scale(4, 5.0), Scale(2, 2.0), Scale(2, 2.0))
_FINE = Scale(1, 0.0)
# At full resolution every second row is enough: smoothing and gradients make neighbouring rows say nearly the same.
_FINE_ROWS_EVERY = 2
_LARGEST_STEP_M = 0.15
_LARGEST_TURN = np.radians(2.0)
# Standard deviation of pitch and roll before the image is seen, radians.
_SD_TILT = np.radians(2.0)
# Neighbouring pixels and both channels err together, and the views are not exact: so many of them count as one. Chosen so
# that errors on recorded data are as large as the covariance says.
_CORRELATED = 25.0
# Mean squared difference at the least: a view that fits exactly, or shows nothing of the image, has none and still errs.
_LEAST_VARIANCE = 1e-4
# Standing still: a step this small is about what the image can tell.
_SMALLEST_STEP_M, _SMALLEST_TURN = 1e-3, np.radians(0.01)
# Sources are weighted by 1 / (distance + this).
_NEAR_M = 0.05
# References whose smoothed features are kept at hand.
_KEPT_FEATURES = 24


class _Equations(NamedTuple):
    normal: Float64
    right: Float64
    residual: float
    pixels: float
    agreement: float


class PoseRefiner:
    """Refines poses by synthesis.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
    settings : VotesSettings
    """

    def __init__(self, synthesizer: ViewSynthesizer, settings: VotesSettings) -> None:
        self._synthesizer = synthesizer
        self._settings = settings
        self._tree = cKDTree(synthesizer.references.positions)
        self._source_planes = lru_cache(maxsize=_KEPT_FEATURES)(self._make_source_planes)

    def refine(self, z: Complex64, usable: Bool, pose: Float64) -> PoseMeasurement:
        """Refine a pose that is right to a few decimetres and degrees.

        Parameters
        ----------
        z, usable : complex64 and bool (rows, columns)
            Features of the image (see `orientations`).
        pose : float64 (3,)
            Where to begin.
        """
        settings = self._settings.refinement
        unknowns = 5 if settings.tilt else 3
        reached, tilt = np.array(pose, dtype=np.float64), np.zeros(2)
        scales = [scale for scale in _COARSE_STEPS if z.shape[1] % scale.stride == 0] + [_FINE] * settings.iterations
        planes = {sigma: _planes(z, usable, sigma) for sigma in {scale.sigma for scale in scales}}
        for scale in scales:
            query, query_usable = self._turned_back(planes[scale.sigma], reached[2], tilt, scale.stride)
            equations = self._equations(query, query_usable, reached[:2], scale)
            step = _solve(equations, tilt, unknowns)
            reached += step[:3]
            tilt += step[3:]
            if scale is _FINE and np.hypot(step[0], step[1]) < _SMALLEST_STEP_M and abs(step[2]) < _SMALLEST_TURN:
                break
        reached[2] = wrap_angle(reached[2])
        inverse = np.linalg.inv(equations.normal[:unknowns, :unknowns] + 1e-9 * np.eye(unknowns))[:3, :3]
        variance = max(equations.residual / max(equations.pixels, 1.0), _LEAST_VARIANCE)
        return PoseMeasurement(
            reached, np.asarray(_CORRELATED * variance * inverse, dtype=np.float64), tilt, equations.agreement
        )

    def _equations(self, query: Complex64, query_usable: Bool, position: Float64, scale: Scale) -> _Equations:
        """Normal equations against the views of the nearest references, the nearer the more."""
        sources = min(self._settings.refinement.sources, len(self._synthesizer.references))
        distances, indices = (np.atleast_1d(part) for part in self._tree.query(position, k=sources))
        rays = self._synthesizer.rays
        # Contiguous, as strided arrays would compile the kernel a second time.
        floor, tangents = (np.ascontiguousarray(part[:: scale.stride]) for part in (rays.floor, rays.tangents))
        normal, right = np.zeros((5, 5)), np.zeros(5)
        residual = count = common = 0.0
        mine = theirs = 1e-12
        for distance, source in zip(distances, indices, strict=True):
            profile = self._synthesizer.profile_at(int(source), position)
            view, view_usable = self._view(int(source), position, profile, scale)
            part = normal_equations(
                view,
                view_usable,
                query,
                query_usable,
                np.ascontiguousarray(profile[:: scale.stride]),
                floor,
                tangents,
                rays.row_step * scale.stride,
                _FINE_ROWS_EVERY if scale is _FINE else 1,
            )
            weight = 1.0 / (float(distance) + _NEAR_M)
            normal += weight * part[0]
            right += weight * part[1]
            residual += weight * part[2]
            count += weight * part[3]
            common += part[4]
            mine += part[5]
            theirs += part[6]
        return _Equations(normal, right, residual, count, common / float(np.sqrt(mine * theirs)))

    def _view(self, source: int, position: Float64, profile: Float64, scale: Scale) -> tuple[Complex64, Bool]:
        if scale is _FINE:
            return orientations(self._synthesizer.view(source, position, profile), self._settings)
        map_x, map_y = self._synthesizer.table(source, position, profile, scale.stride)
        return _read(self._source_planes(source, scale.sigma), map_x, map_y)

    def _make_source_planes(self, source: int, sigma: float) -> Float32:
        return _planes(*orientations(self._synthesizer.references.panorama(source), self._settings), sigma)

    def _turned_back(self, planes: Float32, heading: float, tilt: Float64, stride: int) -> tuple[Complex64, Bool]:
        """Features as an upright camera would have seen them at heading 0."""
        rows, columns = planes.shape[0], planes.shape[1] - 2 * MARGIN
        chosen = np.arange(0, columns, stride)
        azimuth = -2.0 * np.pi * chosen / columns
        # A small tilt lifts the columns sinusoidally with their azimuth; sideways it is of second order near the horizon.
        lift = (tilt[0] * np.cos(azimuth) + tilt[1] * np.sin(azimuth)) / self._synthesizer.rays.row_step
        source_columns = np.mod(chosen + heading * columns / (2.0 * np.pi), columns) + MARGIN
        map_y = (np.arange(0, rows, stride)[:, None] + lift[None, :]).astype(np.float32)
        map_x = np.broadcast_to(source_columns.astype(np.float32), map_y.shape)
        return _read(planes, map_x, map_y)


def _planes(z: Complex64, usable: Bool, sigma: float) -> Float32:
    """Real part, imaginary part and usability, smoothed and continued across the seam: float32 (rows, columns + 2 MARGIN, 3)."""
    # Two boxes of n pixels have the variance (n^2 - 1) / 6; they take the same time for any n.
    box = 2 * round(0.5 * (np.sqrt(6.0 * sigma**2 + 1.0) - 1.0)) + 1
    margin = MARGIN + box
    planes = np.empty((z.shape[0], z.shape[1] + 2 * margin, 3), dtype=np.float32)
    planes[..., 0] = pad_circular(z.real, margin)
    planes[..., 1] = pad_circular(z.imag, margin)
    planes[..., 2] = np.pad(usable, ((0, 0), (margin, margin)), mode="wrap")
    if box > 1:
        smooth = cv2.blur(cv2.blur(planes, (box, box)), (box, box))
        # A pixel is as usable as it was; only what is compared is smoothed.
        smooth[..., 2] = planes[..., 2]
        planes = smooth
    return np.ascontiguousarray(planes[:, box : planes.shape[1] - box])


def _read(planes: Float32, map_x: Float32, map_y: Float32) -> tuple[Complex64, Bool]:
    read = cv2.remap(planes, np.ascontiguousarray(map_x), map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    z = np.ascontiguousarray(read[..., :2]).view(np.complex64)[..., 0]
    return z, read[..., 2] > 0.99


def _solve(equations: _Equations, tilt: Float64, unknowns: int) -> Float64:
    """The step of position, heading and tilt, of a length that can be trusted: float64 (5,)."""
    normal, right = equations.normal.copy(), equations.right.copy()
    # What is known of the tilt beforehand, in the units of the residuals.
    stiffness = equations.residual / max(equations.pixels, 1.0) / _SD_TILT**2
    normal[[3, 4], [3, 4]] += stiffness
    right[3:] -= stiffness * tilt
    regular = normal[:unknowns, :unknowns] + (1e-9 * np.trace(normal[:3, :3]) + 1e-12) * np.eye(unknowns)
    step = np.zeros(5)
    step[:unknowns] = np.linalg.solve(regular, right[:unknowns])
    step[:2] *= min(1.0, _LARGEST_STEP_M / max(float(np.hypot(step[0], step[1])), 1e-12))
    step[2] = np.clip(step[2], -_LARGEST_TURN, _LARGEST_TURN)
    return step

"""The pose of one image to millimetres: Gauss-Newton on the view synthesised around the best place.

Lucas & Kanade (1981) with a view in place of an image patch: each step synthesises the view at the pose reached so far from the nearest
references, takes what a small step of position, heading and tilt would change in it, and solves for the step that explains
the difference to the image. First steps compare smoothed features, which reach farther; the last ones the features as they are.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.config.model import VotesSettings
from panoloc_mcl.eigenspace.gradients import orientations, pad_circular
from panoloc_mcl.geometry import wrap_angle
from panoloc_mcl.kernels.warping import normal_equations
from panoloc_mcl.measurement import PoseMeasurement
from panoloc_mcl.synthesis.views import ViewSynthesizer

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# Smoothing of the features in the first steps, pixels: the reach of a step is a few of these.
_SMOOTHING = (6.0, 3.0, 1.5, 0.7)
_LARGEST_STEP_M = 0.15
_LARGEST_TURN = np.radians(2.0)
# Standard deviation of pitch and roll before the image is seen, radians.
_SD_TILT = np.radians(2.0)
# Neighbouring pixels and both channels err together, and the views are not exact: so many of them count as one. Chosen so
# that errors on recorded data are as large as the covariance says.
_CORRELATED = 50.0
# Converged: a step this small is far below what the image can tell.
_SMALLEST_STEP_M, _SMALLEST_TURN = 3e-4, np.radians(0.005)


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

    def refine(self, z: Complex64, usable: Bool, pose: Float64) -> PoseMeasurement:
        """Refine a pose that is right to a few centimetres and degrees.

        Parameters
        ----------
        z, usable : complex64 and bool (rows, columns)
            Features of the image (see `orientations`).
        pose : float64 (3,)
            Where to begin.
        """
        settings = self._settings.refinement
        unknowns = 5 if settings.tilt else 3
        reached = np.array(pose, dtype=np.float64)
        tilt = np.zeros(2)
        normal, residual, count, agreement = np.eye(5), 0.0, 1.0, 0.0
        for step in range(settings.iterations):
            smoothing = _SMOOTHING[step] if step < len(_SMOOTHING) else 0.0
            query, query_usable = _turned_back(
                _smoothed(z, smoothing), usable, reached[2], tilt, self._synthesizer.rays.row_step
            )
            normal, right, residual, count, agreement = self._equations(query, query_usable, reached[:2], smoothing)
            solution = np.zeros(5)
            # What is known of the tilt beforehand, in the units of the residuals.
            stiffness = residual / max(count, 1.0) / _SD_TILT**2
            normal[3, 3] += stiffness
            normal[4, 4] += stiffness
            right[3:] -= stiffness * tilt
            regular = normal[:unknowns, :unknowns] + 1e-9 * np.trace(normal[:3, :3]) * np.eye(unknowns)
            solution[:unknowns] = np.linalg.solve(regular, right[:unknowns])
            length = float(np.hypot(solution[0], solution[1]))
            solution[:2] *= min(1.0, _LARGEST_STEP_M / max(length, 1e-12))
            solution[2] = np.clip(solution[2], -_LARGEST_TURN, _LARGEST_TURN)
            reached += solution[:3]
            tilt += solution[3:]
            if smoothing == 0.0 and length < _SMALLEST_STEP_M and abs(solution[2]) < _SMALLEST_TURN:
                break
        reached[2] = wrap_angle(reached[2])
        inverse = np.linalg.inv(normal[:unknowns, :unknowns] + 1e-9 * np.eye(unknowns))[:3, :3]
        covariance = np.asarray(_CORRELATED * residual / max(count, 1.0) * inverse, dtype=np.float64)
        return PoseMeasurement(reached, covariance, tilt, agreement)

    def _equations(
        self, query: Complex64, query_usable: Bool, position: Float64, smoothing: float
    ) -> tuple[Float64, Float64, float, float, float]:
        sources = min(self._settings.refinement.sources, len(self._synthesizer.references))
        found = self._tree.query(position, k=sources)
        distances, indices = (np.atleast_1d(part) for part in found)
        normal, right = np.zeros((5, 5)), np.zeros(5)
        residual = count = 0.0
        common, mine, theirs = 0.0, 1e-12, 1e-12
        rays = self._synthesizer.rays
        for distance, source in zip(distances, indices, strict=True):
            profile = self._synthesizer.profile_at(int(source), position)
            view, view_usable = orientations(self._synthesizer.view(int(source), position, profile), self._settings)
            view = _smoothed(view, smoothing)
            part = normal_equations(view, view_usable, query, query_usable, profile, rays.floor, rays.tangents, rays.row_step)
            weight = 1.0 / (distance + 0.05)
            normal += weight * part[0]
            right += weight * part[1]
            residual += weight * part[2]
            count += weight * part[3]
            both = view_usable & query_usable
            common += float(np.sum((view.conj() * query).real, where=both))
            mine += float(np.sum(np.abs(query) ** 2, where=both))
            theirs += float(np.sum(np.abs(view) ** 2, where=both))
        return normal, right, residual, count, common / float(np.sqrt(mine * theirs))


def _smoothed(z: Complex64, sigma: float) -> Complex64:
    if sigma == 0.0:
        return z
    margin = int(np.ceil(3.0 * sigma))
    size = (2 * margin + 1, 2 * margin + 1)
    out = np.empty_like(z)
    out.real = cv2.GaussianBlur(pad_circular(z.real, margin), size, sigma)[:, margin:-margin]
    out.imag = cv2.GaussianBlur(pad_circular(z.imag, margin), size, sigma)[:, margin:-margin]
    return out


def _turned_back(z: Complex64, usable: Bool, heading: float, tilt: Float64, row_step: float) -> tuple[Complex64, Bool]:
    """Features as an upright camera would have seen them at heading 0."""
    rows, columns = z.shape
    shift = heading * columns / (2.0 * np.pi)
    azimuth = -2.0 * np.pi * np.arange(columns) / columns
    # Row displacement of a small tilt varies sinusoidally with the azimuth; its effect on columns is of second order near the horizon.
    lift = (tilt[0] * np.cos(azimuth) + tilt[1] * np.sin(azimuth)) / row_step
    margin = 1
    map_x = np.broadcast_to(np.mod(np.arange(columns) + shift, columns) + margin, (rows, columns)).astype(np.float32)
    map_y = (np.arange(rows)[:, None] + lift[None, :]).astype(np.float32)
    planes = np.dstack([z.real, z.imag, usable.astype(np.float32)])
    planes = np.pad(planes, ((0, 0), (margin, margin), (0, 0)), mode="wrap")
    turned = cv2.remap(planes, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    out = np.empty((rows, columns), dtype=np.complex64)
    out.real, out.imag = turned[..., 0], turned[..., 1]
    return out, turned[..., 2] > 0.99

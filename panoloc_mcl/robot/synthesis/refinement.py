"""The pose of one image to millimetres: Gauss-Newton on the view synthesised around the best place.

Lucas & Kanade (1981) with a synthesised view in place of an image patch: every step takes the view at the pose reached so far from
the nearest references, what a small step of position, heading and tilt would change in it, and solves for the step that explains the
difference to the image. The first steps compare smoothed features on a coarse grid, which reach far and cost little; there the
references' features are warped as they are. The last steps warp the images and compute the features of the result.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.kernels.alignment import column_products, inner_products, normal_equations, sector_pulls
from panoloc_mcl.robot.kernels.warping import turned_table
from panoloc_mcl.robot.measurement import PoseMeasurement, cosine_of
from panoloc_mcl.robot.settings.observation import RefinementSettings, VotesSettings
from panoloc_mcl.robot.synthesis.agreeing_parts import Banded, agreeing
from panoloc_mcl.robot.synthesis.equations import Equations, Views, limit_of
from panoloc_mcl.robot.synthesis.planes import planes_of, read_planes, source_planes
from panoloc_mcl.robot.synthesis.views import MARGIN, ViewSynthesizer

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]
Factors = tuple[float, float]


class Step(NamedTuple):
    """A Gauss-Newton step: at every ``stride`` pixels, smoothed with a standard deviation in pixels, against so many views."""

    stride: int
    sigma: float
    sources: int

    @property
    def fine(self) -> bool:
        """Whether it looks at every pixel of images that were warped themselves."""
        return self.stride == 1


def _steps(settings: RefinementSettings, columns: int) -> tuple[list[Step], list[Step]]:
    """Coarse steps reach far and cost little; the first fine one is still far off, and more references would not help it."""
    few = min(2, settings.sources)
    coarse = [Step(stride, sigma, few) for stride, sigma in _COARSE if columns % stride == 0]
    fine = [Step(1, 0.0, few)] + [Step(1, 0.0, settings.sources)] * max(settings.iterations - 1, 1)
    return coarse or fine[:1], fine


# Every so many pixels, smoothed with this standard deviation in pixels.
_COARSE = ((4, 5.0), (4, 5.0), (2, 2.0), (2, 2.0))
# At full resolution every second row is enough: smoothing and gradients make neighbouring rows say nearly the same.
_FINE_ROWS_EVERY = 2
# Bands of rows that agreement is looked at in; images of few rows have one.
_BANDS, _FEWEST_ROWS = 3, 12
# Sectors whose pulls are taken as independent, so many over the circle: 12 degrees, over which depths are smoothed.
_SECTORS = 30
# An image of the map comes to rest after two or three steps at full resolution. One that has not after so many is looked for around, by
# moves of so many metres in eight directions, so often at most; and by all but the first of them where views do not agree. Set on every
# fourth image of the rendered office at night, and on afternoon_02 of the rendered hall.
_SOON, _MOVES_M, _MOST_MOVES = 6, (0.1, 0.05, 0.025), 4
_COMPASS = np.array([[np.cos(angle), np.sin(angle), 0.0] for angle in np.arange(8) * (np.pi / 4.0)])
# Of several poses, so many.
_REFINED_TO_THE_END = 2
# Standing still: a step this small is about what the image can tell.
_SMALLEST_STEP_M, _SMALLEST_TURN = 1.5e-3, np.radians(0.01)
# Of the standard deviation: a step this small is not worth another one.
_SMALL = 0.3
# From an expected pose, a step so many times as long, and a turn, may be the last: what is left to go is about a sixth of it, or what
# `limit_of` adds.
_LAST, _LAST_OF_FOLLOWED = (1.0, 1.0), (2.0, 5.0)
# Sources are weighted by 1 / (distance + this), and by how sure their own poses are.
_NEAR_M = 0.05
# References whose smoothed features are kept at hand.
_KEPT_FEATURES = 32


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
        # Not of a method: what is kept would keep the refiner, and itself, until the garbage is collected.
        self._source_planes = lru_cache(maxsize=_KEPT_FEATURES)(partial(source_planes, synthesizer.references, settings))

    def __reduce__(self) -> tuple[Any, ...]:
        # Pickled without what it keeps.
        return PoseRefiner, (self._synthesizer, self._settings)

    def refine(self, z: Complex64, usable: Bool, pose: Float64) -> PoseMeasurement:
        """Refine a pose that is right to a few decimetres and degrees.

        Parameters
        ----------
        z, usable : complex64 and bool (rows, columns)
            Features of the image (see `orientations`).
        pose : float64 (3,)
            Where to begin.
        """
        return self.refine_best(z, usable, [pose])[0]

    def polish(self, z: Complex64, usable: Bool, pose: Float64) -> PoseMeasurement:
        """Refine a pose that is right to a few centimetres: by the last steps alone, as coarse ones might lead away from it.

        Parameters
        ----------
        z, usable : complex64 and bool (rows, columns)
            Features of the image (see `orientations`).
        pose : float64 (3,)
            Where to begin.
        """
        _, fine = _steps(self._settings.refinement, z.shape[1])
        planes = {fine[0].sigma: planes_of(z, usable, fine[0].sigma)}
        return self._refined_to_the_end(planes, fine, np.array(pose, dtype=np.float64), np.zeros(2))

    def follow(self, z: Complex64, usable: Bool, pose: Float64, near: bool = True) -> PoseMeasurement:
        """Refine a pose that is expected, right to a decimetre: the coarse steps that reach no farther, then the last ones.

        Parameters
        ----------
        z, usable : complex64 and bool (rows, columns)
            Features of the image (see `orientations`).
        pose : float64 (3,)
        near : bool
            Right to two degrees; if not, all coarse steps are taken.
        """
        coarse, fine = _steps(self._settings.refinement, z.shape[1])
        steps = coarse[len(coarse) // 2 :] if near else coarse
        planes = {sigma: planes_of(z, usable, sigma) for sigma in {step.sigma for step in (*steps, *fine)}}
        start, tilt, _, _ = self._descended(planes, steps, np.array(pose, dtype=np.float64), np.zeros(2))
        return self._refined_to_the_end(planes, fine, start, tilt, _LAST_OF_FOLLOWED)

    def refine_best(
        self, z: Complex64, usable: Bool, poses: Iterable[Float64], sufficient: float = 1.0
    ) -> tuple[PoseMeasurement, list[float]]:
        """Refine the one of several poses around which the views agree best with the image.

        The poses are approached by the coarse steps, which cost little, in turn until one agrees sufficiently; only the best is
        refined to the end, or the best two where the first disappoints.

        Parameters
        ----------
        z, usable : complex64 and bool (rows, columns)
            Features of the image (see `orientations`).
        poses : iterable of float64 (3,)
            Where to begin; at least one.
        sufficient : float
            Agreement (cosine) of smoothed features.

        Returns
        -------
        PoseMeasurement
        list of float
            Agreement that was reached from each pose tried.
        """
        coarse, fine = _steps(self._settings.refinement, z.shape[1])
        planes = {sigma: planes_of(z, usable, sigma) for sigma in {step.sigma for step in (*coarse, *fine)}}
        approached: list[tuple[Float64, Float64, Equations]] = []
        for pose in poses:
            approached.append(self._descended(planes, coarse, np.array(pose, dtype=np.float64), np.zeros(2))[:3])
            if approached[-1][2].cosine >= sufficient:
                break
        agreements = [equations.cosine for *_, equations in approached]
        measured: list[PoseMeasurement] = []
        for index in np.argsort(agreements)[::-1][:_REFINED_TO_THE_END]:
            measured.append(self._refined_to_the_end(planes, fine, *approached[index][:2]))
            if measured[-1].agreement.cosine >= sufficient:
                break
        return max(measured, key=lambda one: one.agreement.cosine), agreements

    def _refined_to_the_end(
        self, planes: Mapping[float, Float32], fine: Sequence[Step], pose: Float64, tilt: Float64, last: Factors = _LAST
    ) -> PoseMeasurement:
        pose, tilt, equations, at_rest = self._descended(planes, fine[:_SOON], pose, tilt, last)
        if len(fine) > _SOON and not (at_rest and equations.settled(self._unknowns)):
            found = self._around(planes, fine[0 if at_rest else -1], pose, tilt, _MOVES_M[1 if at_rest else 0 :])
            if not at_rest or np.any(found != pose):
                pose, tilt, equations, _ = self._descended(planes, fine[_SOON:], found, tilt, last)
        pose[2] = wrap_angle(pose[2])
        leaning = _turned(tilt, -float(pose[2]))
        sources = self._weighted_sources(pose[:2], self._settings.refinement.sources)
        of_map, of_frame = self._synthesizer.errors_at(*sources, pose[:2])
        errors, against = self._synthesizer.errors, equations.contradiction(self._synthesizer.rays.row_step)
        excess = errors.excess(against)
        covariance = errors.of_image(equations.covariance(self._unknowns), excess) + of_map + of_frame
        return PoseMeasurement(pose, covariance, leaning, equations.agreement, of_map, of_frame, against, excess)

    def _descended(
        self, planes: Mapping[float, Float32], steps: Sequence[Step], pose: Float64, tilt: Float64, last: Factors = _LAST
    ) -> tuple[Float64, Float64, Equations, bool]:
        """Pose and tilt after Gauss-Newton steps, the last equations, and whether they ended because nothing moved any more.

        ``last`` are factors on how long a step and its turn may be to be the last.
        The tilt is about the map's axes here: pitch about y, roll about x.
        """
        unknowns, before = self._unknowns, np.zeros(5)
        for step in steps:
            query, query_usable = self._turned_back(planes[step.sigma], pose[2], tilt, step.stride)
            equations = self._equations(query, query_usable, pose[:2], step)
            change = equations.step(tilt, unknowns)
            at_rest = step == steps[-1] and self._is_still(change[:3] / [last[0], last[0], last[1]], equations)
            to_go = limit_of(change, before) if at_rest else change
            pose, tilt = pose + to_go[:3], tilt + to_go[3:]
            if at_rest:
                break
            before = change if step.fine else before
        return pose, tilt, equations, at_rest

    def _around(
        self, planes: Mapping[float, Float32], step: Step, pose: Float64, tilt: Float64, moves: Sequence[float] = _MOVES_M
    ) -> Float64:
        """The pose near one that agrees best with the image: a pattern search (Hooke & Jeeves 1961), by ever smaller moves.

        Where light has moved, its edges pull one way and those of the world another: steps are short in between, and a pose a pixel
        away from the right one may hold. So may one where views are wrong, as inside a goal: there they contradict each other. The
        agreement of all pixels tells the two apart.
        """
        query, usable = self._turned_back(planes[step.sigma], pose[2], tilt, step.stride)
        best = self._cosine(query, usable, pose[:2], step)
        for move in moves:
            for _ in range(_MOST_MOVES):
                around = pose + move * _COMPASS
                agreements = [self._cosine(query, usable, position, step) for position in around[:, :2]]
                ahead = int(np.argmax(agreements))
                if agreements[ahead] <= best:
                    break
                best, pose = agreements[ahead], around[ahead]
        return pose

    def _is_still(self, change: Float64, equations: Equations) -> bool:
        """Whether a step is about what the image can tell, or far less than it does tell."""
        # Sums in single precision may make of a direction that nothing tells one of negative variance.
        sd = np.sqrt(np.maximum(np.diag(equations.noise(self._unknowns)), 0.0))
        far, turned = float(np.hypot(change[0], change[1])), abs(float(change[2]))
        return far < max(_SMALLEST_STEP_M, _SMALL * float(max(sd[0], sd[1]))) and turned < max(
            _SMALLEST_TURN, _SMALL * float(sd[2])
        )

    @property
    def _unknowns(self) -> int:
        return 5 if self._settings.refinement.tilt else 3

    def _equations(self, query: Complex64, query_usable: Bool, position: Float64, step: Step) -> Equations:
        """Normal equations against the views of the nearest references, the nearer the more."""
        weights, indices = self._weighted_sources(position, step.sources)
        rays = self._synthesizer.rays
        # Contiguous, as strided arrays would compile the kernel a second time.
        floor, tangents = (np.ascontiguousarray(part[:: step.stride]) for part in (rays.floor, rays.tangents))
        normal, right = np.zeros((5, 5)), np.zeros(5)
        residual = pixels = 0.0
        bands = _bands(query.shape[0], step)
        columns, pulls = np.zeros((3, len(bands), query.shape[1])), np.zeros((_SECTORS, 5))
        parts, banded = [], []
        for weight, source in zip(weights, indices, strict=True):
            profile, view, view_usable = self._view(int(source), position, step)
            walls, every = np.ascontiguousarray(profile[:: step.stride]), _FINE_ROWS_EVERY if step.fine else 1
            by_band = [
                column_products(
                    view[rows], view_usable[rows], query[rows], query_usable[rows], walls, floor[rows], tangents[rows], every
                )
                for rows in bands
            ]
            products = np.sum(by_band, axis=0)
            chosen = agreeing(products[-3:])
            banded.append(Banded(float(weight), by_band, chosen))
            part = normal_equations(products, chosen, rays.row_step * step.stride)
            parts.append(part)
            pulls += weight * sector_pulls(products, chosen, rays.row_step * step.stride, _SECTORS)
            normal += weight * part[0]
            right += weight * part[1]
            residual += weight * part[2]
            pixels += weight * part[3]
            columns += np.stack([part[-3:] for part in by_band], axis=1)
        views = Views(weights, np.array([part[0] for part in parts]), np.array([part[1] for part in parts]))
        return Equations(normal, right, residual, pixels, columns, pulls, views, banded)

    def _cosine(self, query: Complex64, query_usable: Bool, position: Float64, step: Step) -> float:
        """That of the equations, in a third of their time."""
        sums, every = np.zeros(3), _FINE_ROWS_EVERY if step.fine else 1
        for source in self._weighted_sources(position, step.sources)[1]:
            _, view, view_usable = self._view(int(source), position, step)
            sums += inner_products(view, view_usable, query, query_usable, every)
        return cosine_of(*sums)

    def sources_at(self, position: Float64) -> tuple[Float64, Float64]:
        """Sources of the last views at a position (2,): weights (s,), and offsets from them to it (s, 2), metres."""
        weights, indices = self._weighted_sources(position, self._settings.refinement.sources)
        return weights, position - self._synthesizer.references.positions[indices]

    def _weighted_sources(self, position: Float64, count: int) -> tuple[Float64, NDArray[np.int64]]:
        """Weights and indices of the nearest references that views can be made from; beside one that stands alone, that one."""
        if self._synthesizer.alone.any():
            _, nearest = self._tree.query(position)
            if self._synthesizer.alone[nearest]:
                return np.ones(1), np.array([nearest])
        distances, indices = self._synthesizer.sources_around(position, count)
        weights = self._synthesizer.trust[indices] / (distances + _NEAR_M)
        return weights / weights.sum(), indices

    def _view(self, source: int, position: Float64, step: Step) -> tuple[Float64, Complex64, Bool]:
        """The walls seen from a position, and the features there of what a source sees."""
        profile = self._synthesizer.profile_at(source, position)
        if step.fine:
            return profile, *orientations(self._synthesizer.view(source, position, profile), self._settings)
        map_x, map_y = self._synthesizer.table(source, position, profile, step.stride)
        return profile, *read_planes(self._source_planes(source, step.sigma), map_x, map_y)

    def _turned_back(self, planes: Float32, heading: float, tilt: Float64, stride: int) -> tuple[Complex64, Bool]:
        """Features as an upright camera would have seen them at heading 0."""
        rays, columns = self._synthesizer.rays, planes.shape[1] - 2 * MARGIN
        azimuths = np.arange(0, columns, stride) * (-2.0 * np.pi / columns)
        rotation, _ = cv2.Rodrigues(np.array([*_turned(tilt, -heading)[::-1], 0.0]))
        tangents = np.ascontiguousarray(rays.tangents[::stride])
        return read_planes(
            planes, *turned_table(tangents, azimuths, heading, rotation, rays.top, rays.row_step, columns, MARGIN)
        )


def _bands(rows: int, step: Step) -> list[slice]:
    """Thirds of the rows, where all are looked at closely; the first and last row of each only lend to their neighbours."""
    count = _BANDS if step.fine and rows >= _FEWEST_ROWS else 1
    # Odd, so that every second row is the same as without bands.
    edges = [1, *(2 * (rows * band // (2 * count)) + 1 for band in range(1, count)), rows - 1]
    return [slice(first - 1, last + 1) for first, last in itertools.pairwise(edges)]


def _turned(tilt: Float64, angle: float) -> Float64:
    """Pitch and roll about level axes that are turned by an angle against those of ``tilt``, float64 (2,): the same rotation."""
    pitch, roll = tilt
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([sin * roll + cos * pitch, cos * roll - sin * pitch])

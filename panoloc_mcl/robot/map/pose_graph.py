"""The pose graph: poses of keyframes that fit measured relative poses and what was given, though some of both are wrong.

Least squares over SE(2) by Gauss-Newton on sparse normal equations (SciPy's SuperLU: a graph of a thousand keyframes takes
milliseconds, and the robot needs no other library for it). Wrong measurements are told by graduated non-convexity with the
Geman-McClure function (Yang et al. 2020): the problem begins convex, where none is left out, and hardens until those that the others
contradict weigh nothing. How large errors of measurements and of given poses usually are is not a constant but estimated from the graph
itself (variance components): where given poses are as exact as images can tell, they are believed and nothing moves. Errors that many
measurements have in common are unknowns, too: poses get no surer than these allow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from panoloc_mcl.robot.geometry import angle_difference, between, compose, wrap_angle
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Edges

Float64 = NDArray[np.float64]

# Squared residual of three unknowns, in standard deviations, that 99 % of right measurements stay below; and its median.
_USUAL, _MEDIAN = 11.34, 2.366
_HARDENING = 1.4
_STEPS_AT_THE_END = 8
_LEAST_WEIGHT = 1e-6
# Rounds of estimating variances; they settle to a few percent.
_ROUNDS = 12
_SETTLED = 0.02
_SMALL_M, _SMALL_RAD = 1e-6, 1e-7
# Errors of measurements are not thought smaller or larger than so many times what they claim.
_SCALES = (0.5, 5.0)
# A measurement with this weight lies at the bound of what is usual; those above it are right.
_AT_THE_BOUND = 0.25
# What such a measurement is worth under this loss, against least squares: of normal errors of three unknowns, the inverse of the
# variance of an estimate is E[w + 2/3 q w']^2 / E[q w^2 / 3] (Huber 1981, chapter 6); q is the squared residual, w its weight.
_WORTH = 0.903
# Given poses with more weight than this tell how far given poses are off; of normal errors so much of their variance is left by then.
_COUNTED, _LEFT = 0.3, 0.928
# Measurements that bear out each other less than this say nothing of their errors.
_PROBES, _LEAST_FREEDOM = 12, 0.1
# Columns of the inverse that are solved for at once.
_BLOCK = 300


@dataclass(frozen=True, eq=False)
class Priors:
    """Given poses.

    Parameters
    ----------
    poses : float64 (n, 3)
    sds : float64 (n, 2)
        Standard deviations of position (each axis, metres) and heading (radians); NaN: one for all of these, to be estimated;
        infinite: nothing is given.
    robust : bool
        Whether single ones may be far off.
    """

    poses: Float64
    sds: Float64
    robust: bool = True


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """Errors that many measurements have in common, each of unknown size.

    Parameters
    ----------
    effects : sparse matrix of float64 (3 m, k)
        What a unit of each adds to the measured relative poses, edge after edge.
    sds : float64 (k,)
        Standard deviations of their sizes.
    """

    effects: sparse.csc_matrix
    sds: Float64

    @classmethod
    def none(cls, edges: int) -> Self:
        """No such errors."""
        return cls(sparse.csc_matrix((3 * edges, 0)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Solution:
    """What fits best.

    Parameters
    ----------
    poses : float64 (n, 3)
    covariances : float64 (n, 3, 3)
    edges : Edges
        As given, with weights.
    prior_weights : float64 (n,)
        How far every given pose is borne out.
    prior_sds : float64 (2,)
        Estimated for given poses without standard deviations; metres and radians.
    scale : float
        Errors of measurements between images, in the standard deviations that they came with.
    """

    poses: Float64
    covariances: Float64
    edges: Edges
    prior_weights: Float64
    prior_sds: Float64
    scale: float


def solve(
    start: Float64,
    edges: Edges,
    priors: Priors,
    least_prior_sds: tuple[float, float] = (1e-4, 1e-5),
    common: CommonErrors | None = None,
) -> Solution:
    """Poses that fit edges and priors, with the variances of both estimated where they are not known.

    Parameters
    ----------
    start : float64 (n, 3)
        Where to begin.
    edges : Edges
        Their weights are not used; edges of odometry keep their covariances and are never contradicted by it.
    priors : Priors
    least_prior_sds : (float, float)
        Given poses are not thought more exact than this, metres and radians.
    common : CommonErrors, optional
        Of the edges.
    """
    common = CommonErrors.none(len(edges)) if common is None else common
    images = edges.kinds != ODOMETRY
    free = np.isnan(priors.sds)
    least = np.array(least_prior_sds)
    scale, sds = 1.0, np.array([0.05, np.radians(1.0)])
    for _ in range(_ROUNDS):
        problem = _Problem(edges, priors, common, scale, sds)
        state, edge_weights, prior_weights = problem.robust(start)
        poses = problem.poses(state)
        new_scale = float(np.clip(scale * problem.spread(state, edge_weights, prior_weights, images), *_SCALES))
        new_sds = sds.copy()
        away = poses - priors.poses
        away[:, 2] = wrap_angle(away[:, 2])
        inverse = problem.covariances(state, edge_weights, prior_weights) if free.any() else np.zeros((len(poses), 3, 3))
        for column, axes in enumerate(([0, 1], [2])):
            used = free[:, column] & (prior_weights > _COUNTED)
            if used.any():
                # Expectation maximisation: how far given poses are from the best ones, and how surely these are known.
                squares = np.mean(away[used][:, axes] ** 2 / _LEFT + inverse[used][:, axes, axes], axis=1)
                new_sds[column] = max(float(np.sqrt(np.mean(squares))), least[column])
        change = max(abs(np.log(new_scale / scale)), float(np.abs(np.log(new_sds / sds)).max()))
        scale, sds, start = new_scale, new_sds, poses
        if change < _SETTLED:
            break
    found = replace(edges, weights=edge_weights)
    return Solution(poses, problem.covariances(state, edge_weights, prior_weights), found, prior_weights, sds, scale)


def closure_error(edges: Edges) -> float:
    """By how much relative poses miss their start round a triangle, in the median, as a share of their usual length; 0 without any."""
    found = {(int(i), int(j)): pose for i, j, pose in zip(edges.first, edges.second, edges.measured, strict=True)}
    found |= {(j, i): between(pose, np.zeros(3)) for (i, j), pose in found.items()}
    ends: dict[int, set[int]] = {}
    for first, second in found:
        ends.setdefault(first, set()).add(second)
    misses = [
        float(np.hypot(*compose(compose(found[i, j], found[j, k]), found[k, i])[:2]))
        for i in sorted(ends)
        for j in sorted(ends[i])
        for k in sorted(ends[i] & ends[j])
        if i < j < k
    ]
    length = float(np.median(np.hypot(*edges.measured[:, :2].T))) if misses else 0.0
    return float(np.median(misses)) / length if length > 0.0 else 0.0


class _Problem:
    """Residuals, weights and normal equations for fixed variances; the state holds 3 n unknowns of poses and k of common errors."""

    def __init__(self, edges: Edges, priors: Priors, common: CommonErrors, scale: float, prior_sds: Float64) -> None:
        self.edges = edges
        self.count = len(priors.poses)
        factor = np.where(edges.kinds == ODOMETRY, 1.0, scale)
        self.whitening = np.linalg.inv(np.linalg.cholesky(edges.covariances)) / factor[:, None, None]
        sds = np.where(np.isnan(priors.sds), prior_sds, priors.sds)[:, [0, 0, 1]]
        with np.errstate(divide="ignore"):
            self.stiffness = np.where(np.isfinite(sds), 1.0 / sds, 0.0)
        self.priors = priors
        index = np.arange(len(edges) + 1)
        whole = sparse.bsr_matrix((self.whitening, index[:-1], index), shape=(3 * len(edges), 3 * len(edges)))
        self.effects = sparse.csc_matrix(whole @ common.effects)
        self.common_stiffness = 1.0 / common.sds

    def poses(self, state: Float64) -> Float64:
        """Of the state, float64 (n, 3)."""
        return state[: 3 * self.count].reshape(-1, 3)

    def edge_residuals(self, state: Float64) -> Float64:
        """Whitened, float64 (m, 3)."""
        poses = self.poses(state)
        a, b = poses[self.edges.first], poses[self.edges.second]
        cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        found = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, angle_difference(b[:, 2], a[:, 2])])
        residuals = found - self.edges.measured
        residuals[:, 2] = wrap_angle(residuals[:, 2])
        common = self.effects @ state[3 * self.count :]
        return np.asarray(np.einsum("mij,mj->mi", self.whitening, residuals) - common.reshape(-1, 3))

    def prior_residuals(self, state: Float64) -> Float64:
        """Whitened, float64 (n, 3)."""
        residuals = self.poses(state) - self.priors.poses
        residuals[:, 2] = wrap_angle(residuals[:, 2])
        return residuals * self.stiffness

    def robust(self, poses: Float64) -> tuple[Float64, Float64, Float64]:
        """The state, and weights of edges and priors, by graduated non-convexity."""
        sure = self.edges.kinds == ODOMETRY
        state = np.concatenate([poses.ravel(), np.zeros(len(self.common_stiffness))])
        edge_squares, prior_squares = self._squares(state)
        worst = max(float(edge_squares[~sure].max(initial=0.0)), float(prior_squares.max(initial=0.0)) * self.priors.robust)
        hardness = max(1.0, 2.0 * worst / _USUAL)
        ends = 0
        while True:
            edge_weights = np.where(sure, 1.0, _geman_mcclure(edge_squares, hardness))
            prior_weights = _geman_mcclure(prior_squares, hardness) if self.priors.robust else np.ones(self.count)
            step = self._step(state, edge_weights, prior_weights)
            state = state + step
            self.poses(state)[:, 2] = wrap_angle(self.poses(state)[:, 2])
            edge_squares, prior_squares = self._squares(state)
            if hardness > 1.0:
                hardness = max(1.0, hardness / _HARDENING)
                continue
            ends += 1
            moved = np.abs(self.poses(step))
            still = moved[:, :2].max() < _SMALL_M and moved[:, 2].max() < _SMALL_RAD
            if still or ends >= _STEPS_AT_THE_END:
                return state, edge_weights, prior_weights

    def covariances(self, state: Float64, edge_weights: Float64, prior_weights: Float64) -> Float64:
        """Of every pose, float64 (n, 3, 3): the blocks on the diagonal of the inverse."""
        # The loss weighs right measurements, too, by how well they happen to fit; how much is known does not depend on that.
        edge_weights, prior_weights = (np.where(w >= _AT_THE_BOUND, _WORTH, w) for w in (edge_weights, prior_weights))
        # These are taken as they are.
        edge_weights[self.edges.kinds == ODOMETRY] = 1.0
        if not self.priors.robust:
            prior_weights = np.ones(self.count)
        factor = _factor(self._normal(state, edge_weights, prior_weights)[0])
        blocks = np.empty((self.count, 3, 3))
        for first in range(0, 3 * self.count, _BLOCK):
            last = min(first + _BLOCK, 3 * self.count)
            unit = np.zeros((len(state), last - first))
            unit[np.arange(first, last), np.arange(last - first)] = 1.0
            columns = factor.solve(unit)
            for node in range(first // 3, last // 3):
                block = columns[3 * node : 3 * node + 3, 3 * node - first : 3 * node - first + 3]
                blocks[node] = 0.5 * (block + block.T)
        return blocks

    def spread(self, state: Float64, edge_weights: Float64, prior_weights: Float64, images: NDArray[np.bool_]) -> float:
        """Errors of measurements between images, in the standard deviations assumed; 1 where they are too few to say."""
        if not images.any():
            return 1.0
        jacobian, _ = self._jacobian(state, edge_weights)
        factor = _factor(self._normal(state, edge_weights, prior_weights)[0])
        # What the poses were fitted to looks smaller than it is: by the trace of the hat matrix, estimated by a few random signs.
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (3 * len(self.edges), _PROBES)) * np.repeat(images, 3)[:, None]
        seen = jacobian.T @ signs
        used = float(np.sum(seen * factor.solve(seen))) / _PROBES
        freedom = 1.0 - used / (3.0 * max(float(edge_weights[images].sum()), 1e-9))
        if freedom < _LEAST_FREEDOM:
            return 1.0
        squares = np.sum(self.edge_residuals(state)[images] ** 2, axis=1)
        return float(np.sqrt(np.median(squares) / _MEDIAN / freedom))

    def _squares(self, state: Float64) -> tuple[Float64, Float64]:
        return np.sum(self.edge_residuals(state) ** 2, axis=1), np.sum(self.prior_residuals(state) ** 2, axis=1)

    def _step(self, state: Float64, edge_weights: Float64, prior_weights: Float64) -> Float64:
        normal, right = self._normal(state, edge_weights, prior_weights)
        return np.asarray(_factor(normal).solve(right))

    def _jacobian(self, state: Float64, edge_weights: Float64) -> tuple[sparse.csc_matrix, Float64]:
        """Of the whitened, weighted residuals of the edges, (3 m, 3 n + k), and the roots of their weights."""
        edges, count, poses = self.edges, self.count, self.poses(state)
        a, b = poses[edges.first], poses[edges.second]
        cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        zero, one = np.zeros(len(edges)), np.ones(len(edges))
        of_first = np.array([[-cos, -sin, cos * dy - sin * dx], [sin, -cos, -cos * dx - sin * dy], [zero, zero, -one]])
        of_second = np.array([[cos, sin, zero], [-sin, cos, zero], [zero, zero, one]])
        root = np.sqrt(np.maximum(edge_weights, _LEAST_WEIGHT))[:, None, None]
        whitening = self.whitening * root
        jacobian = np.stack([whitening @ np.moveaxis(of_first, 2, 0), whitening @ np.moveaxis(of_second, 2, 0)], axis=1)
        ends = np.stack([edges.first, edges.second], axis=1)
        shape = (len(edges), 2, 3, 3)
        rows = np.broadcast_to(3 * np.arange(len(edges))[:, None, None, None] + np.arange(3)[:, None], shape)
        columns = np.broadcast_to(3 * ends[:, :, None, None] + np.arange(3), shape)
        matrix = sparse.csc_matrix((jacobian.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * len(edges), 3 * count))
        roots = root[:, 0, 0]
        return sparse.hstack([matrix, -sparse.diags(np.repeat(roots, 3)) @ self.effects], format="csc"), roots

    def _normal(self, state: Float64, edge_weights: Float64, prior_weights: Float64) -> tuple[sparse.csc_matrix, Float64]:
        """Normal equations, of 3 n + k unknowns."""
        of_edges, root = self._jacobian(state, edge_weights)
        prior_root = np.sqrt(np.maximum(prior_weights, _LEAST_WEIGHT))[:, None] * self.stiffness
        residuals = (self.edge_residuals(state) * root[:, None]).ravel()
        stiffness = np.concatenate([prior_root.ravel(), self.common_stiffness])
        normal = of_edges.T @ of_edges + sparse.diags(stiffness**2 + 1e-9)
        prior = self.prior_residuals(state) * np.sqrt(np.maximum(prior_weights, _LEAST_WEIGHT))[:, None]
        common = state[3 * self.count :] * self.common_stiffness
        right = -(of_edges.T @ residuals) - np.concatenate([prior.ravel(), common]) * stiffness
        return sparse.csc_matrix(normal), np.asarray(right)


def _factor(normal: sparse.csc_matrix) -> SuperLU:
    """Of a symmetric positive definite matrix: ordered by its own pattern, that few rows which touch all others come last."""
    return splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _geman_mcclure(squares: Float64, hardness: float) -> Float64:
    bound = hardness * _USUAL
    return np.asarray((bound / (bound + squares)) ** 2)

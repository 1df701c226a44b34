"""What is believed before an image is seen, as a density; and what its pose is worth against it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.filters.particles.clusters import find_clusters
from panoloc_mcl.robot.kernels.filtering.weights import normal_density
from panoloc_mcl.robot.observation.places import Places

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Particles that the hypotheses are found among: many enough for their moments, few enough to cost nothing.
_LOOKED_AT = 1024
# Odometry and measured poses now and then err by more than their covariances say: this share of the density lies this much wider.
_WIDER_SHARE, _WIDER_M, _WIDER_RAD = 0.1, 0.1, math.radians(2.0)
# A cluster of equal particles has no volume.
_LEAST_M, _LEAST_RAD = 1e-4, 1e-5


@dataclass(frozen=True, eq=False)
class Prior:
    """The hypotheses of a belief.

    Parameters
    ----------
    clusters : tuple of Cluster
    """

    clusters: tuple[Cluster, ...]

    @classmethod
    def of(cls, particles: CompactPoses, weights: Float32) -> Self:
        """From particles and their weights (n,), of which every so many-th is looked at."""
        step = -(-len(particles) // _LOOKED_AT)
        some = weights[::step]
        total = float(some.sum())
        if total <= 0.0:
            step, some, total = 1, weights, 1.0
        return cls(find_clusters(particles[::step], some / np.float32(total)))

    def widened(self, covariance: Float64) -> Self:
        """The same with a likeliest hypothesis that is wider by a covariance."""
        first, *others = self.clusters
        return type(self)((replace(first, covariance=first.covariance + covariance), *others))

    def gap(self, count: int) -> float:
        """How far apart so many particles are, metres: spread of the hypotheses over the third root of the count."""
        spread = sum(cluster.mass * math.sqrt(max(np.trace(cluster.covariance[:2, :2]), 0.0)) for cluster in self.clusters)
        return float(spread / count ** (1.0 / 3.0))

    def density(self, poses: Float64) -> Float64:
        """At poses (n, 3): one over square metres and radians, float64 (n,)."""
        out, poses = np.zeros(len(poses)), np.ascontiguousarray(poses)
        for share, mean, whitening, scale in self._parts:
            out += share * normal_density(poses, mean, whitening, scale)
        return out

    @cached_property
    def _parts(self) -> list[tuple[float, Float64, Float64, float]]:
        """Normal distributions that it is made of: share, mean, and what `_whitened` gives. It is read for every block of particles."""
        floor = np.diag([_LEAST_M**2, _LEAST_M**2, _LEAST_RAD**2])
        wider = np.diag([_WIDER_M**2, _WIDER_M**2, _WIDER_RAD**2])
        return [
            (share * cluster.mass, cluster.pose, *_whitened(cluster.covariance + more))
            for cluster in self.clusters
            for share, more in ((1.0 - _WIDER_SHARE, floor), (_WIDER_SHARE, wider))
        ]


def gaussian(poses: Float64, mean: Float64, covariance: Float64) -> Float64:
    """Density of a normal distribution of poses, (n, 3), one over square metres and radians; headings by the shorter way round."""
    return normal_density(np.ascontiguousarray(poses), mean, *_whitened(covariance))


def _whitened(covariance: Float64) -> tuple[Float64, float]:
    """What makes errors independent and of variance 1, (3, 3), and the logarithm of the density at the mean."""
    factor = np.linalg.cholesky(covariance)
    # Log of the determinant and not the product: millimetres to the third are small.
    scale = -1.5 * math.log(2.0 * math.pi) - float(np.log(np.diag(factor)).sum())
    return np.linalg.inv(factor), scale


def uniform_density(places: Places) -> float:
    """Of a robot that may be anywhere on the map with any heading: one over its square metres and radians."""
    return 1.0 / (max(len(places.covered), 1) * places.raster.cell**2 * 2.0 * math.pi)

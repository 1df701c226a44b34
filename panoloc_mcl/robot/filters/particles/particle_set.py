"""Weighted poses: moved, weighed and drawn anew, a block at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters.base import Start
from panoloc_mcl.robot.filters.particles.blocks import BLOCK, Blocks
from panoloc_mcl.robot.filters.particles.clusters import occupied_bins
from panoloc_mcl.robot.filters.particles.resampling import SCHEMES, adaptive_count, effective_count, normalise
from panoloc_mcl.robot.kernels.filtering.particles import predict, take
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.settings.localizer import AdaptiveSettings, MonteCarloSettings

Float32 = NDArray[np.float32]

_KEPT = ("origin", "x", "y", "turns")
_TYPES = [np.float32, np.float32, np.uint32, np.float32]


class ParticleSet:
    """Particles of a filter.

    Parameters
    ----------
    particles : CompactPoses
    threads : int

    Attributes
    ----------
    particles : CompactPoses
        Steps change them, and the weights, in place: with a million particles fresh memory costs as much as the work.
    weights : float32 (n,)
        Sum 1 between the steps.
    """

    def __init__(self, particles: CompactPoses, threads: int) -> None:
        self.blocks = Blocks(threads)
        self.particles = particles
        self._spare = CompactPoses.empty(particles.origin, 0)
        self.weights: Float32 = np.empty(0, dtype=np.float32)
        self._weigh_alike()

    def __len__(self) -> int:
        return len(self.particles)

    def _weigh_alike(self) -> None:
        if len(self.weights) != len(self):
            self.weights = np.empty(len(self), dtype=np.float32)
        self.weights.fill(1.0 / len(self))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it, by name."""
        return {name: getattr(self.particles, name) for name in _KEPT} | {"weights": self.weights}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], like: ParticleSet) -> Self:
        """What `arrays` gave, to be worked on as another set is.

        Raises
        ------
        KeyError, ValueError
            Something is missing, or of another type or shape.
        """
        particles, weights = CompactPoses(*(np.array(arrays[name]) for name in _KEPT)), np.array(arrays["weights"])
        count = len(weights)
        if count == 0 or particles.origin.shape != (2,) or any(part.shape != (count,) for part in particles.arrays):
            raise ValueError(f"particles of shapes {[part.shape for part in particles.arrays]} do not fit {count} weights")
        if [part.dtype for part in (*particles.arrays, weights)] != _TYPES:
            raise ValueError("particles are not of the types that they are kept in")
        if not all(np.isfinite(part).all() for part in (particles.origin, particles.x, particles.y, weights)):
            raise ValueError("positions or weights are not finite")
        kept = cls(particles, like.blocks.threads)
        kept.weights = weights
        return kept

    @classmethod
    def of_the_form_before(cls, arrays: Mapping[str, NDArray[Any]], like: ParticleSet) -> Self:
        """Of poses (n, 3) in double precision, and logarithms of weights up to a constant; raises as `of_arrays`."""
        poses, logs = arrays["poses"], arrays["log_weights"]
        if poses.ndim != 2 or poses.shape != (len(logs), 3) or len(poses) == 0 or not np.isfinite(poses).all():
            raise ValueError(f"poses of shape {poses.shape} do not fit {len(logs)} weights, or are not finite")
        kept = cls(CompactPoses.of(poses, like.particles.origin), like.blocks.threads)
        kept.weights = np.exp(logs - logs.max()).astype(np.float32)
        kept.normalise()
        return kept

    def normalise(self) -> None:
        """Make the weights sum to 1."""
        normalise(self.weights)

    def moved(self, particles: CompactPoses, motion: Motion, key: int, step: int) -> CompactPoses:
        """Particles after a motion, each with noise of its own; in place."""
        parts = np.array([motion.first_turn, motion.along, motion.across, motion.last_turn])
        sds = np.array([motion.sd_first_turn, motion.sd_along, motion.sd_across, motion.sd_last_turn])

        def move(block: slice) -> None:
            predict(*particles.arrays, parts, sds, key, step, block.start, block.stop)

        self.blocks.each(move, len(particles))
        return particles

    def mean(self, values: Float32) -> float:
        """Weighted mean of values (n,)."""
        blocks = [slice(start, start + BLOCK) for start in range(0, len(self), BLOCK)]
        return float(sum(float(self.weights[block] @ values[block]) for block in blocks))

    def resample(self, settings: MonteCarloSettings, rng: np.random.Generator) -> tuple[float, bool]:
        """Draw the particles that go on, if too few of them count for as many as are wanted.

        Returns
        -------
        effective : float
            N_eff before.
        resampled : bool
        """
        weights, count = self.weights, len(self)
        effective = effective_count(weights)
        draw = SCHEMES[settings.resampling.scheme]
        wanted = count
        if settings.adaptive.enabled:
            wanted = _wanted(self.particles[draw(weights, count, rng)], settings.adaptive)
        if effective >= settings.resampling.below * max(count, wanted):
            return effective, False
        if len(self._spare) != wanted:
            self._spare = CompactPoses.empty(self.particles.origin, wanted)
        take(*self.particles.arrays, draw(weights, wanted, rng), *self._spare.arrays)
        self.particles, self._spare = self._spare, self.particles
        self._weigh_alike()
        return effective, True


def _wanted(survivors: CompactPoses, settings: AdaptiveSettings) -> int:
    """As many particles as the bins that survivors fill ask for."""
    around = max(1, round(360.0 / settings.bin_deg))
    return adaptive_count(occupied_bins(survivors, settings.bin_m, around), settings)


def drawn_from(start: Start, places: Places, count: int, rng: np.random.Generator) -> CompactPoses:
    """Particles of which a start knows no better."""
    poses = np.empty((count, 3))
    origin = np.rint(places.positions.mean(axis=0))
    if start.covariance is not None and start.position is not None:
        mean = np.array([*start.position, start.heading or 0.0])
        poses[:] = rng.multivariate_normal(mean, start.covariance, count, method="eigh")
        return CompactPoses.of(poses, origin)
    if start.position is None:
        poses[:, :2] = places.sample_uniform(count, rng)
    else:
        poses[:, :2] = np.asarray(start.position) + rng.normal(0.0, start.sd_position, (count, 2))
    if start.heading is None:
        poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
    else:
        poses[:, 2] = start.heading + rng.normal(0.0, start.sd_heading, count)
    return CompactPoses.of(poses, origin)

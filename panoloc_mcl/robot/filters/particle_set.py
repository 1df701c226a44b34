"""Weighted poses: moved, weighed and drawn anew, a block at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.base import Start
from panoloc_mcl.robot.filters.blocks import BLOCK, Blocks
from panoloc_mcl.robot.filters.clusters import grid_of
from panoloc_mcl.robot.filters.resampling import SCHEMES, adaptive_count, effective_count, normalise, normalised
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.kernels.particles import propagate
from panoloc_mcl.robot.kernels.resampling import taken
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.settings.localizer import AdaptiveSettings, MonteCarloSettings

Float64 = NDArray[np.float64]


class ParticleSet:
    """Particles of a filter.

    Parameters
    ----------
    poses : float64 (n, 3)
    threads : int

    Attributes
    ----------
    poses : float64 (n, 3)
        A view of rows x, y, heading, which is how the kernels want them. Steps change it, and the weights, in place: with a million
        particles fresh memory costs as much as the work.
    log_weights : float64 (n,)
        Up to a constant.
    weights : float64 (n,)
        The same as shares of 1.
    """

    def __init__(self, poses: Float64, threads: int) -> None:
        self.blocks = Blocks(threads)
        self.poses = poses
        self.log_weights, self.weights = np.empty(0), np.empty(0)
        self.weigh_alike()

    def __len__(self) -> int:
        return len(self.poses)

    def weigh_alike(self) -> None:
        """Give all the same weight."""
        count = len(self.poses)
        if len(self.weights) != count:
            self.log_weights, self.weights = np.empty(count), np.empty(count)
        self.log_weights.fill(0.0)
        self.weights.fill(1.0 / count)

    def restore(self, poses: Float64, log_weights: Float64) -> None:
        """Take over poses (n, 3) and log-weights (n,)."""
        self.poses, self.log_weights = np.array(poses.T, order="C").T, np.array(log_weights)
        self.weights = normalised(self.log_weights)

    def normalise(self) -> None:
        """Work out the weights from the log-weights."""
        normalise(self.log_weights, self.weights)

    def moved(self, poses: Float64, motion: Motion, key: int, step: int) -> Float64:
        """Poses (n, 3) after a motion, each with noise of its own; in place."""
        parts = (motion.first_turn, motion.along, motion.across, motion.last_turn)
        noise = (motion.sd_first_turn, motion.sd_along, motion.sd_across, motion.sd_last_turn)
        particles = poses.T

        def move(block: slice) -> None:
            particles[:, block] = propagate(particles, *parts, *noise, key, step, block.start, block.stop)

        self.blocks.each(move, len(poses))
        return poses

    def mean(self, values: Float64) -> float:
        """Weighted mean of values (n,)."""
        blocks = [slice(start, start + BLOCK) for start in range(0, len(self.weights), BLOCK)]
        return float(sum(self.weights[block] @ values[block] for block in blocks))

    def resample(self, settings: MonteCarloSettings, rng: np.random.Generator) -> tuple[float, bool]:
        """Draw the particles that go on, if too few of them count for as many as are wanted.

        Returns
        -------
        effective : float
            N_eff before.
        resampled : bool
        """
        weights, count = self.weights, len(self.weights)
        effective = effective_count(weights)
        draw = SCHEMES[settings.resampling.scheme]
        wanted = count
        if settings.adaptive.enabled:
            wanted = self._wanted(self.poses[draw(weights, count, rng)], settings.adaptive)
        if effective >= settings.resampling.below * max(count, wanted):
            return effective, False
        chosen = draw(weights, wanted, rng)
        if wanted != count:
            self.poses = self.poses.T.take(chosen, axis=1).T
        else:
            for row in self.poses.T:
                row[:] = taken(row, chosen)
        self.weigh_alike()
        return effective, True

    @staticmethod
    def _wanted(survivors: Float64, settings: AdaptiveSettings) -> int:
        """As many as the bins that survivors (n, 3) fill ask for."""
        turns = max(1, round(360.0 / settings.bin_deg))
        grid = grid_of(np.ascontiguousarray(survivors.T), settings.bin_m, turns)
        return adaptive_count(len(grid.occupied), settings)


def drawn_from(start: Start, places: Places, count: int, rng: np.random.Generator) -> Float64:
    """Poses (n, 3) of which a start knows no better."""
    poses = np.empty((3, count)).T
    if start.covariance is not None and start.position is not None:
        mean = np.array([*start.position, start.heading or 0.0])
        poses[:] = rng.multivariate_normal(mean, start.covariance, count, method="eigh")
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses
    if start.position is None:
        poses[:, :2] = places.sample_uniform(count, rng)
    else:
        poses[:, :2] = np.asarray(start.position) + rng.normal(0.0, start.sd_position, (count, 2))
    if start.heading is None:
        poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
    else:
        poses[:, 2] = wrap_angle(start.heading + rng.normal(0.0, start.sd_heading, count))
    return poses

"""What one image says about poses, relative to what it says on the mean over the map; and how it is shared out to particles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters.particles.blocks import BLOCK
from panoloc_mcl.robot.filters.particles.particle_set import ParticleSet
from panoloc_mcl.robot.filters.particles.prior import Prior, gaussian
from panoloc_mcl.robot.kernels.filtering.weights import weigh
from panoloc_mcl.robot.measurement import PoseMeasurement
from panoloc_mcl.robot.motion import Motion, carried
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

_TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """One image.

    Parameters
    ----------
    votes : VoteField
    measured : (float64 (3,), float64 (3, 3)) or None
        The pose that the image gives by itself at the particles' time, and its covariance.
    doubt : float
        Chance that the image is wrong about the pose.
    floor : float
        Least likelihood by the votes.
    sharpness : float
        Power that the likelihood by the votes is taken to, 1 at most.
    mean : float
        Likelihood by the votes, averaged over the map.
    uniform : float
        Density of a robot that may be anywhere.
    """

    votes: VoteField
    measured: tuple[Float64, Float64] | None
    doubt: float
    floor: float
    sharpness: float
    mean: float
    uniform: float

    @classmethod
    def of(
        cls,
        votes: VoteField,
        offset: Motion | None,
        gap: float,
        uniform: float,
        settings: MonteCarloSettings,
        new: float = 1.0,
    ) -> Self:
        """As the settings have it.

        While particles lie far apart, each stands for all around it: the likelihood by the votes is blurred with the ``gap`` between
        them (Pfaff, Burgard & Fox 2006). Votes fall by one tolerance over ``annealing_m``, so gaps add to the tolerance by squares.

        Parameters
        ----------
        votes : VoteField
        offset : Motion, optional
            From the particles' time to the image's. Its noise, the other way, adds to that of the measured pose.
        gap : float
            Metres.
        uniform : float
        settings : MonteCarloSettings
        """
        sharpness = 1.0 / (1.0 + (gap / settings.annealing_m) ** 2) if settings.annealing_m > 0.0 else 1.0
        measured = None
        if votes.measurement is not None and settings.measured_share > 0.0 and _sharper_than_votes(votes, votes.measurement):
            measured = votes.measurement.pose, votes.measurement.covariance
            if offset is not None:
                measured = carried(*measured, offset.reversed())
        mean = votes.mean_likelihood(sharpness)
        doubt = max(settings.measured_doubt, votes.doubt)
        # Where an image knows its doubt, that is the least likelihood.
        floor = 0.0 if measured is None and not math.isnan(votes.confidence) else settings.floor
        # Blocks of particles may be read in several threads at once; what they share is worked out here.
        _ = votes.peak, votes.places.raster
        return cls(votes, measured, doubt, floor, sharpness, (1.0 - floor) * mean + floor, uniform)

    @property
    def calibrated(self) -> bool:
        """Whether the image knows its own doubt."""
        return not math.isnan(self.votes.confidence)

    def by_votes(self, particles: CompactPoses, out: Float32) -> Float32:
        """By the votes where particles were at the image's time, relative to the best cell: 1 at most (but for interpolation).

        Into float32 (n,), which is returned.
        """
        self.votes.read_likelihood(particles, self.sharpness, self.floor, out)
        return out

    @property
    def wrong(self) -> tuple[float, float]:
        """All of the likelihood but what the measured pose says, relative to its mean over the map: slope and level over `by_votes`."""
        if self.measured is not None:
            return self.doubt / self.mean, 0.0
        return (1.0 - self.doubt) / self.mean, self.doubt

    def by_luck(self, fit: float) -> float:
        """What poses of so good a fit by the votes, on the mean, get beyond the map's mean in case that the measured pose is wrong.

        Votes of an image that is wrong about its pose may speak against a belief; if they speak for it, that is luck.
        """
        return 0.0 if self.measured is None else max(self.doubt * (fit / self.mean - 1.0), 0.0)

    def at_measured(self, poses: Float64, prior: Prior) -> tuple[Float64, Float64]:
        """What the measured pose says at poses (n, 3), and what was expected, both relative to their mean over the map."""
        assert self.measured is not None
        return gaussian(poses, *self.measured) / self.uniform, prior.density(poses) / self.uniform


def _sharper_than_votes(votes: VoteField, measurement: PoseMeasurement) -> bool:
    """A measured pose that is not says nothing, for instance that of an image that shares hardly a pixel with the view there."""
    return float(np.linalg.eigvalsh(measurement.covariance[:2, :2])[-1]) < votes.places.spacing**2


@dataclass(frozen=True)
class Plan:
    """Who represents what after an image.

    Parameters
    ----------
    elsewhere : float
        Chance, before the image, that the robot is not where odometry led.
    predicted, from_pose, from_votes : int
        Particles that odometry moved, that are drawn from the measured pose, and from the votes.
    """

    elsewhere: float
    predicted: int
    from_pose: int
    from_votes: int

    def predicted_part(self, said: Float64, expected: Float64) -> Float64:
        """What predicted particles get for the measured pose.

        Particles of both kinds lie where image and prediction agree; each has the share of what is there that particles of its kind
        have in all (the balance heuristic of Veach & Guibas 1995).
        """
        ours, theirs = self.predicted * expected, self.from_pose * said
        return np.asarray(said * ours / np.maximum(ours + theirs, _TINY))

    def drawn_part(self, said: Float64, expected: Float64) -> Float64:
        """The same of particles that were drawn from the measured pose."""
        ours, theirs = self.predicted * expected, self.from_pose * said
        return np.asarray(theirs * expected / np.maximum(ours + theirs, _TINY))


def weigh_predicted(predicted: ParticleSet, image: Likelihood, prior: Prior, plan: Plan, fit: Float32) -> float:
    """Multiply weights by the likelihood, of which ``fit`` (n,) is that by the votes; returns its mean.

    The weights no longer sum to 1: against them, `Drawn` are weighed.
    """
    explained = np.zeros(-(-len(fit) // BLOCK))
    slope, level = (part * (1.0 - plan.elsewhere) for part in image.wrong)

    def multiply(block: slice) -> None:
        weights = predicted.weights[block]
        if plan.from_pose:
            said = plan.predicted_part(*image.at_measured(predicted.particles[block].poses, prior))
            weights *= slope * fit[block] + level + (1.0 - plan.elsewhere) * (1.0 - image.doubt) * said
        else:
            weigh(weights, fit[block], slope, level)
        explained[block.start // BLOCK] = weights.sum()

    predicted.blocks.each(multiply, len(fit))
    return float(explained.sum())


@dataclass(frozen=True, eq=False)
class Drawn:
    """Particles that are drawn from the image, in the place of others.

    Parameters
    ----------
    where : int64 (m,)
        Indices of the others. Evenly spread over all from a random start: like particles lie next to each other, so none of a kind
        goes altogether.
    left : float
        Share of the belief that is not theirs: the weights of the rest grow no more, those of the drawn shrink.
    """

    where: NDArray[np.int64]
    left: float

    @classmethod
    def of(cls, plan: Plan, particles: ParticleSet, rng: np.random.Generator) -> Self:
        """Who makes room, while weights still are those before the image."""
        count, drawn = len(particles), plan.from_pose + plan.from_votes
        first = int(rng.integers(count))
        if not drawn:
            return cls(np.zeros(0, dtype=np.int64), 1.0)
        where = (np.arange(drawn) * count // drawn + first) % count
        return cls(where, max(1.0 - float(particles.weights[where].sum()), _TINY))

    def put(
        self,
        into: ParticleSet,
        image: Likelihood,
        prior: Prior,
        plan: Plan,
        fit: Float32,
        rng: np.random.Generator,
        moved: Callable[..., CompactPoses],
    ) -> float:
        """Draw them; returns how much of the image those from the measured pose show to be as predicted.

        ``moved(particles, back=...)`` brings particles to the time of a late image, or back from there.
        """
        particles, weights, drawn, explained = into.particles, into.weights, len(self.where), 0.0
        by_votes = np.zeros(drawn, dtype=np.bool_)
        by_votes[np.arange(plan.from_votes) * drawn // max(plan.from_votes, 1)] = True
        if plan.from_votes:
            where, then = self.where[by_votes], CompactPoses.of(image.votes.sample(plan.from_votes, rng), particles.origin)
            fit[where] = image.by_votes(then, fit[where])
            particles[where] = moved(then, back=True)
            mass = plan.elsewhere * (image.doubt if plan.from_pose else 1.0 - image.doubt)
            weights[where] = mass * self.left / plan.from_votes
        if plan.from_pose:
            assert image.measured is not None
            where, poses = self.where[~by_votes], rng.multivariate_normal(*image.measured, plan.from_pose, method="cholesky")
            right = (1.0 - image.doubt) / plan.from_pose
            as_predicted = right * (1.0 - plan.elsewhere) * plan.drawn_part(*image.at_measured(poses, prior))
            now = CompactPoses.of(poses, particles.origin)
            particles[where] = now
            weights[where] = (as_predicted + right * plan.elsewhere) * self.left
            fit[where] = image.by_votes(moved(now, back=False), fit[where])
            explained = float(as_predicted.sum())
        return explained

"""Monte Carlo localization over (x, y, heading) with proposals drawn from the image itself.

Propagate, recover, reweight, resample, estimate (Thrun, Burgard & Fox, "Probabilistic Robotics", chapter 8). `update` is Bayes' rule
with two chances in it: that the robot was carried elsewhere since the last image (share k), and that the image is wrong about itself
(its doubt d). Before the image the belief is then

    (1 - k) predicted + k uniform over the map

and the image's likelihood, relative to its mean over the map, is

    (1 - d) measured + d field      or, for an image that gives no pose by itself,      (1 - d) field + d

with the field's votes and the Gaussian of the measured pose both scaled to mean 1 over the map. Each product of the two is
represented by particles drawn where it is large (the mixture proposal of Thrun, Fox, Burgard & Dellaert 2001, who call the second
and third rows dual):

    who                                how many                  weigh together
    predicted particles                the rest                  (1 - k) times the likelihood's mean over them
    drawn from the measured pose       measured_share            (1 - d) times (k + (1 - k) times the predicted density there)
    drawn from the votes               see `_injection_share`    k times what the field is believed

So an image that contradicts the belief divides it in proportion k : d; the next one decides. Where the map is not calibrated,
images do not know their doubt; then two running averages of how well they fit tell k (augmented MCL).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.base import Start
from panoloc_mcl.robot.filters.blocks import BLOCK, Blocks
from panoloc_mcl.robot.filters.clusters import find_clusters, grid_of
from panoloc_mcl.robot.filters.estimate import FilterState, Status
from panoloc_mcl.robot.filters.likelihood import Likelihood, Plan
from panoloc_mcl.robot.filters.prior import Prior, uniform_density
from panoloc_mcl.robot.filters.resampling import SCHEMES, adaptive_count, effective_count, normalise, normalised
from panoloc_mcl.robot.filters.status import status_of
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.kernels.particles import propagate
from panoloc_mcl.robot.kernels.resampling import taken
from panoloc_mcl.robot.kernels.weights import reweighted
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings, StatusSettings

Float64 = NDArray[np.float64]

# Share of the weight that particles drawn from the first image stand for, when nothing is known.
_DRAWN_AT_START = 0.9
_TINY = float(np.finfo(np.float64).tiny)


class MonteCarloFilter:
    """Particles over position and heading.

    Every random number is a function of the key, the step and, where it concerns one particle, of its index: see `kernels.random`.

    Parameters
    ----------
    places : Places
        Of the map: where a robot can be.
    start : Start
    settings : MonteCarloSettings
    status : StatusSettings
    rng : numpy.random.Generator
        Gives the key of all random numbers.

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

    def __init__(
        self, places: Places, start: Start, settings: MonteCarloSettings, status: StatusSettings, rng: np.random.Generator
    ) -> None:
        self.places = places
        self.settings = settings
        self.status_settings = status
        self._key, self._step = int(rng.integers(2**63)), 0
        self._blocks = Blocks(settings.threads)
        self.poses = self._drawn_from(start)
        self.log_weights, self.weights = np.empty(0), np.empty(0)
        self._weigh_alike()
        self._nothing_known = start.position is None and start.heading is None
        self._has_converged = False
        # Whether the last answer was that the pose is known; and where odometry led from it, until an image has been seen.
        self._sure = False
        self._expected: tuple[float, ...] | None = None
        self._match = math.nan
        self._match_slow = self._match_fast = math.nan
        self._fit = math.nan
        self._elsewhere = math.nan
        self._votes: VoteField | None = None
        self._place_votes = math.nan
        self._effective = float(settings.particles)
        self._resampled = False
        self._injected = 0

    def _next_step(self) -> np.random.Generator:
        """Random numbers of the next step of the filter, whatever was drawn before."""
        self._step += 1
        return np.random.Generator(np.random.Philox(key=self._key, counter=[0, 0, 0, self._step]))

    def _weigh_alike(self) -> None:
        count = len(self.poses)
        if len(self.weights) != count:
            self.log_weights, self.weights = np.empty(count), np.empty(count)
        self.log_weights.fill(0.0)
        self.weights.fill(1.0 / count)

    def _drawn_from(self, start: Start) -> Float64:
        rng, count = self._next_step(), self.settings.particles
        poses = np.empty((3, count)).T
        if start.covariance is not None and start.position is not None:
            mean = np.array([*start.position, start.heading or 0.0])
            poses[:] = rng.multivariate_normal(mean, start.covariance, count, method="eigh")
            poses[:, 2] = wrap_angle(poses[:, 2])
            return poses
        if start.position is None:
            poses[:, :2] = self.places.sample_uniform(count, rng)
        else:
            poses[:, :2] = np.asarray(start.position) + rng.normal(0.0, start.sd_position, (count, 2))
        if start.heading is None:
            poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
        else:
            poses[:, 2] = wrap_angle(start.heading + rng.normal(0.0, start.sd_heading, count))
        return poses

    def propagate(self, motion: Motion) -> None:
        """Move every particle by odometry with noise; without motion nothing changes at all."""
        if not motion.stands:
            self._move(self.poses, motion)

    def _move(self, poses: Float64, motion: Motion) -> Float64:
        """Poses (n, 3) after a motion, each with noise of its own; in place."""
        self._step += 1
        parts = (motion.first_turn, motion.along, motion.across, motion.last_turn)
        noise = (motion.sd_first_turn, motion.sd_along, motion.sd_across, motion.sd_last_turn)
        particles = poses.T

        def move(block: slice) -> None:
            particles[:, block] = propagate(particles, *parts, *noise, self._key, self._step, block.start, block.stop)

        self._blocks.each(move, len(poses))
        return poses

    def heading_hypotheses(self, offset: Motion | None) -> None:
        """Particles look at all headings."""
        return

    def update(self, votes: VoteField, offset: Motion | None = None) -> None:
        """Weigh the particles by what an image says, with recovery and resampling.

        Parameters
        ----------
        votes : VoteField
            Over the full circle.
        offset : Motion, optional
            For a late image: the motion from the particles' time to the image's, with its noise. The particles are weighed where
            they were then.
        """
        self._votes, self._resampled, self._injected, self._expected = votes, False, 0, None
        if not votes.informative:
            self._match = math.nan
            return
        rng = self._next_step()
        prior = Prior.of(self.poses, self.weights)
        if self._sure:
            best = prior.clusters[0]
            self._expected = (*best.pose.tolist(), best.spread_m, best.spread_deg)
        image = Likelihood.of(votes, offset, prior.gap(len(self.poses)), self._uniform, self.settings)
        fit = self._fit_of_particles(image, offset)
        self._judge(fit)
        plan = self._plan(image)
        explained = self._weigh_predicted(image, prior, plan, fit)
        explained += self._draw(image, prior, plan, offset, fit, rng)
        normalise(self.log_weights, self.weights)
        # How much more the image is explained by where odometry led than by anywhere else.
        self._elsewhere = 0.0 if self._nothing_known else plan.elsewhere / (plan.elsewhere + explained)
        self._nothing_known = False
        self._judge_posterior(fit)
        del fit
        self._resample(rng)

    @cached_property
    def _uniform(self) -> float:
        return uniform_density(self.places)

    def _fit_of_particles(self, image: Likelihood, offset: Motion | None) -> Float64:
        """Likelihood by the votes alone, float64 (n,), where the particles were when the image was taken."""
        seen_from = self.poses if offset is None else self._move(self.poses.copy(order="K"), offset)
        out = np.empty(len(seen_from))

        def read(block: slice) -> None:
            out[block] = image.by_votes(seen_from[block])

        self._blocks.each(read, len(seen_from))
        return out

    def _judge(self, likelihood: Float64) -> None:
        """How much of the best cell's likelihood the prediction explains, now and in the running averages."""
        self._match = self._mean(likelihood)
        if math.isnan(self._match_slow):
            self._match_slow = self._match_fast = self._match
            return
        recovery = self.settings.recovery
        self._match_slow += recovery.slow * (self._match - self._match_slow)
        self._match_fast += recovery.fast * (self._match - self._match_fast)

    def _judge_posterior(self, likelihood: Float64) -> None:
        """Running share of the best votes that the belief explains once it has seen the image: low where images do not fit it.

        Before the image a wide belief explains little, too, for instance after a long way without images.
        """
        fit = self._mean(likelihood)
        self._fit = fit if math.isnan(self._fit) else self._fit + self.settings.recovery.fast * (fit - self._fit)

    def _mean(self, values: Float64) -> float:
        """Weighted mean over the particles."""
        blocks = [slice(start, start + BLOCK) for start in range(0, len(self.weights), BLOCK)]
        return float(sum(self.weights[block] @ values[block] for block in blocks))

    def _plan(self, image: Likelihood) -> Plan:
        """Chance that the robot is not where odometry led, before the image is seen, and who represents it."""
        recovery, count = self.settings.recovery, len(self.poses)
        from_pose = 0 if image.measured is None else int(self.settings.measured_share * count)
        if recovery.max_share == 0.0:
            return Plan(0.0, count - from_pose, from_pose, 0)
        if self._nothing_known:
            # What is predicted and what is drawn stand for the same; what is drawn does so better.
            elsewhere, share = _DRAWN_AT_START, recovery.max_share
        else:
            share = self._injection_share()
            elsewhere = recovery.carried_off if image.calibrated else max(recovery.carried_off, share)
        from_votes = min(int(share * count), count - from_pose)
        return Plan(elsewhere, count - from_pose - from_votes, from_pose, from_votes)

    def _weigh_predicted(self, image: Likelihood, prior: Prior, plan: Plan, fit: Float64) -> float:
        """Multiply the weights by the likelihood; returns its mean, with what is to be drawn counted out."""
        explained = np.zeros(-(-len(fit) // BLOCK))
        # Log-weights become those of weights that summed to 1 before the image, times what all have in common.
        shift = float(self.log_weights.max()) - math.log(float(self.weights.max()) * max(1.0 - plan.elsewhere, _TINY))

        def weigh(block: slice) -> None:
            values = image.wrong(fit[block])
            if plan.from_pose:
                values += (1.0 - image.doubt) * plan.predicted_part(*image.at_measured(self.poses[block], prior))
            explained[block.start // BLOCK] = self.weights[block] @ values
            self.log_weights[block] = reweighted(self.log_weights[block], values, shift)

        self._blocks.each(weigh, len(fit))
        return (1.0 - plan.elsewhere) * float(sum(explained))

    def _draw(
        self, image: Likelihood, prior: Prior, plan: Plan, offset: Motion | None, fit: Float64, rng: np.random.Generator
    ) -> float:
        """Draw particles from the image in the place of others; returns how much of the image those show to be as predicted."""
        count, drawn, explained = len(self.poses), plan.from_pose + plan.from_votes, 0.0
        # Evenly spread over all from a random start: like particles lie next to each other, so none of a kind goes altogether.
        replaced = (np.arange(drawn) * count // max(drawn, 1) + int(rng.integers(count))) % count
        by_votes = np.zeros(drawn, dtype=np.bool_)
        by_votes[np.arange(plan.from_votes) * drawn // max(plan.from_votes, 1)] = True
        # The weights of the others grow no more for it: those of the drawn shrink.
        left = max(1.0 - float(self.weights[replaced].sum()), _TINY)
        if plan.from_votes:
            where, poses = replaced[by_votes], image.votes.sample(plan.from_votes, rng)
            fit[where] = image.by_votes(poses)
            if offset is not None:
                poses = self._move(np.asarray(poses, order="F"), offset.reversed())
            self.poses[where] = poses
            mass = plan.elsewhere * (image.doubt if plan.from_pose else 1.0 - image.doubt)
            self.log_weights[where] = math.log(max(mass * left / plan.from_votes, _TINY))
        if plan.from_pose:
            assert image.measured is not None
            where, poses = replaced[~by_votes], rng.multivariate_normal(*image.measured, plan.from_pose, method="cholesky")
            poses[:, 2] = wrap_angle(poses[:, 2])
            right = (1.0 - image.doubt) / plan.from_pose
            as_predicted = right * (1.0 - plan.elsewhere) * plan.drawn_part(*image.at_measured(poses, prior))
            self.poses[where] = poses
            self.log_weights[where] = np.log(np.maximum((as_predicted + right * plan.elsewhere) * left, _TINY))
            # They lie where the votes are best, as near as matters.
            fit[where] = 1.0
            explained = float(as_predicted.sum())
        self._injected = drawn
        return explained

    def _injection_share(self) -> float:
        recovery = self.settings.recovery
        fallen = 1.0 - self._match_fast / self._match_slow if self._match_slow > 0.0 else 1.0
        share = min(max(fallen, recovery.min_share), recovery.max_share)
        if fallen > 0.5 and share > recovery.min_share:
            # The burst is on its way; judge it afresh instead of injecting for as long as the averages remember.
            self._match_fast = self._match_slow
        return share

    def _resample(self, rng: np.random.Generator) -> None:
        """Draw the particles that go on, if the weights have become too uneven, or more or fewer are wanted."""
        settings, weights, count = self.settings, self.weights, len(self.weights)
        self._effective = effective_count(weights)
        draw = SCHEMES[settings.resampling.scheme]
        wanted = count
        if settings.adaptive.enabled:
            survivors = np.ascontiguousarray(self.poses[draw(weights, count, rng)].T)
            turns = max(1, round(360.0 / settings.adaptive.bin_deg))
            wanted = adaptive_count(len(grid_of(survivors, settings.adaptive.bin_m, turns).occupied), settings.adaptive)
        if wanted != count:
            self.poses = self.poses.T.take(draw(weights, wanted, rng), axis=1).T
        elif self._effective < settings.resampling.below * count:
            chosen = draw(weights, count, rng)
            for row in self.poses.T:
                row[:] = taken(row, chosen)
        else:
            return
        self._weigh_alike()
        self._resampled = True

    def state(self) -> FilterState:
        """Clusters, status and the figures behind it."""
        clusters = find_clusters(self.poses, self.weights)
        best = clusters[0]
        status = status_of(clusters, self._fit, self._elsewhere, self._expected, self._has_converged, self.status_settings)
        self._sure = status is Status.CONVERGED
        self._has_converged |= self._sure
        place = self.places.nearest_reference(best.pose[:2])
        if self._votes is not None:
            informative = self._votes.informative
            self._place_votes = float(self._votes.read(best.pose[None])[0]) if informative else math.nan
        return FilterState(
            clusters=clusters,
            status=status,
            match=self._match,
            best_place=place,
            best_place_votes=self._place_votes,
            particle_count=len(self.poses),
            injected=self._injected,
            effective_count=self._effective,
            resampled=self._resampled,
            elsewhere=self._elsewhere,
        )

    def particles(self) -> tuple[Float64, Float64]:
        """Poses (n, 3) and weights (n,), as the filter works on them."""
        return self.poses, self.weights

    def snapshot(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """All that the next step depends on: arrays, and a header of plain values."""
        return {"poses": self.poses, "log_weights": self.log_weights}, {name: getattr(self, name) for name in _REMEMBERED}

    def restore(self, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave; the vote field of the last image is gone, the figures from it are not.

        Raises
        ------
        KeyError, ValueError
            Something is missing, or of another shape.
        """
        poses, log_weights = arrays["poses"], arrays["log_weights"]
        if poses.ndim != 2 or poses.shape != (len(log_weights), 3) or len(poses) == 0 or not np.isfinite(poses).all():
            raise ValueError(f"poses of shape {poses.shape} do not fit {len(log_weights)} weights, or are not finite")
        values = {name: header[name] for name in _REMEMBERED}
        self.poses, self.log_weights, self._votes = np.array(poses.T, order="C").T, np.array(log_weights), None
        self.weights = normalised(self.log_weights)
        vars(self).update(values)


# Of the filter, besides the particles.
_REMEMBERED = (
    "_key",
    "_step",
    "_nothing_known",
    "_has_converged",
    "_sure",
    "_expected",
    "_match",
    "_match_slow",
    "_match_fast",
    "_fit",
    "_elsewhere",
    "_place_votes",
    "_effective",
    "_resampled",
    "_injected",
)

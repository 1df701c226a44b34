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

Images in a row err alike: the measured pose is weighed for what is new about it (`filters/shared_error.py`), and votes for the share
that the way driven makes new. An image that tells nothing new leaves the particles as they are, so standing still teaches nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters.base import Start
from panoloc_mcl.robot.filters.estimate import Cluster, FilterState, Status
from panoloc_mcl.robot.filters.memory import Memory
from panoloc_mcl.robot.filters.particles.clusters import find_clusters
from panoloc_mcl.robot.filters.particles.likelihood import Drawn, Likelihood, Plan, weigh_predicted
from panoloc_mcl.robot.filters.particles.particle_set import ParticleSet, drawn_from
from panoloc_mcl.robot.filters.particles.prior import Prior, gaussian, uniform_density
from panoloc_mcl.robot.filters.shared_error import Seen, SharedError, kept_share, new_share
from panoloc_mcl.robot.filters.status import status_of, vouches_for
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings, StatusSettings
from panoloc_mcl.robot.synthesis.spacing import usual_spacing

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

_FORM = "monte_carlo/5"
# Poses in double precision and logarithms of weights; the older also kept the error that images share in another way.
_FORMS_BEFORE = ("monte_carlo/4", "monte_carlo/3")

# Share of the weight that particles drawn from the first image get, when nothing is known.
_DRAWN_AT_START = 0.9
# A hypothesis with this share of the weight stands alone: an image that tells nothing new of it has nothing to decide.
_ALONE = 0.98
_LEAST_WAY_M = 1e-6


class MonteCarloFilter:
    """Particles over position and heading.

    Every random number is a function of the key, the step and, where it concerns one particle, of its index (see
    `kernels.filtering.random`).

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
    memory : Memory
        All that is remembered besides the particles and the error that images share.
    """

    def __init__(
        self, places: Places, start: Start, settings: MonteCarloSettings, status: StatusSettings, rng: np.random.Generator
    ) -> None:
        self.places = places
        self.settings = settings
        self.status_settings = status
        nothing_known = start.position is None and start.heading is None
        self.memory = Memory(int(rng.integers(2**63)), 0, nothing_known, float(settings.particles), vouched=not nothing_known)
        self._random = np.random.Generator(np.random.Philox(0))
        self._fresh = self._random.bit_generator.state
        self._shared: SharedError | None = None
        self._answer: FilterState | None = None
        # What the last image told for the belief.
        self._backing, self._vouches = math.nan, not nothing_known
        self._set = ParticleSet(drawn_from(start, places, settings.particles, self._next_step()), settings.threads)

    @property
    def poses(self) -> Float64:
        """Of the particles, float64 (n, 3), a copy."""
        return self._set.particles.poses

    @property
    def weights(self) -> Float32:
        """Shares of 1, float32 (n,)."""
        return self._set.weights

    def _next_step(self) -> np.random.Generator:
        """Random numbers of the next step of the filter, whatever was drawn before."""
        self.memory.step += 1
        at = {"counter": np.array([0, 0, 0, self.memory.step], np.uint64), "key": np.array([self.memory.key, 0], np.uint64)}
        # Set to the step: a new generator takes four times as long.
        self._random.bit_generator.state = {**self._fresh, "state": at}
        return self._random

    def propagate(self, motion: Motion) -> None:
        """Move every particle by odometry with noise; without motion nothing changes at all."""
        if not motion.stands:
            # Who has moved at all has not stood.
            self.memory.way += max(motion.distance, _LEAST_WAY_M)
            # Moved like the particles: only an image can refute what the last answer was sure of, not the way since.
            self.memory.lead_on(motion.increment)
            self._answer = None
            self._move(self._set.particles, motion)

    def _move(self, particles: CompactPoses, motion: Motion) -> CompactPoses:
        self.memory.step += 1
        return self._set.moved(particles, motion, self.memory.key, self.memory.step)

    def _move_by(self, offset: Motion | None, particles: CompactPoses, *, back: bool) -> CompactPoses:
        """From the particles' time to a late image's, or back."""
        return particles if offset is None else self._move(particles, offset.reversed() if back else offset)

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
        self.memory.forget_last_image()
        if votes.informative:
            rng = self._next_step()
            prior = self._predicted()
            image = self._likelihood(votes, offset, prior)
            fit = self._fit_of_particles(image, offset)
            recovery = self.settings.recovery
            self.memory.matched(self._set.mean(fit), recovery.slow, recovery.fast)
            image, seen = self._in_the_light_of_before(image, prior, offset)
            plan = self._plan(image, seen)
            if seen is not None and not seen.new and prior.clusters[0].mass > _ALONE:
                explained, luck = self._explained_without_news(image, prior, plan), 0.0
            else:
                luck = image.by_luck(self.memory.match)
                prior = prior if seen is None else self._widened(prior, seen, rng)
                drawn = Drawn.of(plan, self._set, rng)
                explained = weigh_predicted(self._set, image, prior, plan, fit)
                explained += drawn.put(self._set, image, prior, plan, fit, rng, partial(self._move_by, offset))
                self.memory.injected = len(drawn.where)
                self._set.normalise()
            self._judge_posterior(fit, plan, explained)
            self._backing = explained / (1.0 - plan.elsewhere) - luck
            self.memory.effective, self.memory.resampled = self._set.resample(self.settings, rng)
        self._remember(votes, offset)

    def _predicted(self) -> Prior:
        """The hypotheses before the image; if the last answer was sure, where odometry led from it is remembered."""
        prior = Prior.of(self._set.particles, self.weights)
        if self.memory.sure:
            best = prior.clusters[0]
            self.memory.expected = (*best.pose.tolist(), best.spread_m, best.spread_deg)
        return prior

    def _likelihood(self, votes: VoteField, offset: Motion | None, prior: Prior) -> Likelihood:
        """What the image says; votes only for as much as the way since the image before makes new."""
        new, memory = 1.0, self.memory
        if memory.seen is not None and self.settings.correlated:
            way = math.hypot(*(votes.best_pose - np.array(memory.seen))[:2].tolist())
            way = max(way, memory.way, 0.0 if offset is None else offset.distance)
            new = new_share(way, self._spacing)
        return Likelihood.of(votes, offset, prior.gap(len(self._set)), self._uniform, self.settings, new)

    @cached_property
    def _uniform(self) -> float:
        return uniform_density(self.places)

    @cached_property
    def _spacing(self) -> float:
        references = self.places.references
        return usual_spacing(self.places.positions if references is None else references)

    def _fit_of_particles(self, image: Likelihood, offset: Motion | None) -> Float32:
        """Likelihood by the votes alone, float32 (n,), where the particles were when the image was taken."""
        seen_from = self._set.particles if offset is None else self._move_by(offset, self._set.particles.copy(), back=False)
        out = np.empty(len(seen_from), dtype=np.float32)
        self._set.blocks.each(lambda block: image.by_votes(seen_from[block], out[block]), len(seen_from))
        return out

    def _in_the_light_of_before(self, image: Likelihood, prior: Prior, offset: Motion | None) -> tuple[Likelihood, Seen | None]:
        """The image with its measured pose for what is new about it, and what became of the error that images in a row share."""
        measurement = image.votes.measurement
        if image.measured is None or measurement is None:
            return image, None
        pose, covariance = image.measured
        if self._shared is None or not self.settings.correlated:
            self._shared = SharedError(pose, covariance)
            return image, None
        way = self.memory.way + (0.0 if offset is None else offset.distance)
        # Where the robot stands, particles far out are what an image has left to decide.
        cluster = find_clusters(self._set.particles, self.weights)[0] if way == 0.0 else prior.clusters[0]
        seen = self._shared.seen(cluster, pose, covariance, kept_share(measurement, way, self._spacing))
        self._shared = seen.shared
        return replace(image, measured=(pose, seen.covariance)), seen

    def _widened(self, prior: Prior, seen: Seen, rng: np.random.Generator) -> Prior:
        """The belief, wider by what it may share with the image."""
        if not seen.widening.any():
            return prior
        noise = rng.multivariate_normal(np.zeros(3), seen.widening, len(self._set), method="cholesky")
        self._set.particles[:] = CompactPoses.of(self.poses + noise, self._set.particles.origin)
        return prior.widened(seen.widening)

    def _plan(self, image: Likelihood, seen: Seen | None) -> Plan:
        """Chance that the robot is not where odometry led, before the image is seen, and who represents it."""
        recovery, count = self.settings.recovery, len(self._set)
        from_pose = 0 if image.measured is None else int(self.settings.measured_share * count)
        if recovery.max_share == 0.0:
            return Plan(0.0, count - from_pose, from_pose, 0)
        if self.memory.nothing_known:
            # Predicted and drawn particles represent the same uniform prior; the drawn ones lie where the likelihood is.
            elsewhere, share = _DRAWN_AT_START, recovery.max_share
        else:
            share = self._injection_share()
            elsewhere = recovery.carried_off if image.calibrated else max(recovery.carried_off, share)
        from_votes = min(int(share * count), count - from_pose)
        return Plan(elsewhere, count - from_pose - from_votes, from_pose, from_votes)

    def _injection_share(self) -> float:
        recovery, fallen = self.settings.recovery, self.memory.fallen
        share = min(max(fallen, recovery.min_share), recovery.max_share)
        if fallen > 0.5 and share > recovery.min_share:
            # The burst is on its way; judge it afresh instead of injecting for as long as the averages remember.
            self.memory.match_fast = self.memory.match_slow
        return share

    def _explained_without_news(self, image: Likelihood, prior: Prior, plan: Plan) -> float:
        """How much an image is as predicted that tells nothing new."""
        assert image.measured is not None
        best = prior.clusters[0]
        said = float(gaussian(best.pose[None], image.measured[0], image.measured[1] + best.covariance)[0]) / image.uniform
        return (1.0 - plan.elsewhere) * ((1.0 - image.doubt) * said + image.doubt)

    def _judge_posterior(self, likelihood: Float32, plan: Plan, explained: float) -> None:
        """Whether odometry led here, and the running share of the best votes that the belief explains once it has seen the image.

        Before the image a wide belief explains little, too, for instance after a long way without images.
        """
        memory = self.memory
        memory.explained(self._set.mean(likelihood), self.settings.recovery.fast)
        # How much more the image is explained by where odometry led than by anywhere else.
        memory.elsewhere = 0.0 if memory.nothing_known else plan.elsewhere / (plan.elsewhere + explained)
        memory.nothing_known = False

    def _remember(self, votes: VoteField, offset: Motion | None) -> None:
        """What the next image needs to know of this one."""
        clusters = find_clusters(self._set.particles, self.weights)
        memory, before = self.memory, self.memory.vouched
        if votes.informative:
            memory.place_votes = float(votes.read(clusters[0].pose[None])[0])
            memory.seen, memory.way = tuple(votes.best_pose.tolist()), 0.0
            seconded, self._vouches = self._vouches, vouches_for(clusters[0], votes, offset is not None, self.status_settings)
            # Noise differs from image to image: two that agree are not wrong by it.
            enough = self._vouches and (seconded or not votes.noisy)
            memory.vouched = enough or (before and (memory.sure or not memory.known))
        self._answer = self._judged(clusters)
        memory.sure = self._answer.status is Status.CONVERGED
        if votes.informative and not memory.sure:
            # What images stood behind is not what the next one may make of it.
            memory.vouched = before and not memory.known

    def state(self) -> FilterState:
        """Clusters, status and the figures behind it; asking changes nothing."""
        if self._answer is None:
            self._answer = self._judged(find_clusters(self._set.particles, self.weights))
        return self._answer

    def _judged(self, clusters: tuple[Cluster, ...]) -> FilterState:
        memory = self.memory
        return FilterState(
            clusters=clusters,
            status=status_of(
                clusters, memory.fit, memory.elsewhere, memory.expected, memory.known, memory.vouched, self.status_settings
            ),
            match=memory.match,
            best_place=self.places.nearest_reference(clusters[0].pose[:2]),
            best_place_votes=memory.place_votes,
            particle_count=len(self._set),
            injected=memory.injected,
            effective_count=memory.effective,
            resampled=memory.resampled,
            elsewhere=memory.elsewhere,
            backing=self._backing,
            vouches=self._vouches,
        )

    def particles(self) -> tuple[Float64, Float64]:
        """Poses (n, 3) and weights (n,), copies."""
        return self.poses, self.weights.astype(np.float64)

    def snapshot(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """All that the next step depends on: arrays, and a header of plain values."""
        arrays = self._set.arrays()
        if self._shared is not None:
            arrays["shared"] = self._shared.arrays()
        return arrays, {**self.memory.header(_FORM), "backing": self._backing, "vouches": self._vouches}

    def restore(self, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave, of this version or of one before.

        Raises
        ------
        KeyError, ValueError
            Something is missing, of another form, or of another shape.
        """
        form = header.get("form")
        kept = (ParticleSet.of_the_form_before if form in _FORMS_BEFORE else ParticleSet.of_arrays)(arrays, self._set)
        memory = Memory.of_header(header, form if form in _FORMS_BEFORE else _FORM)
        shared = SharedError.of_arrays(arrays["shared"]) if "shared" in arrays else None
        # Older versions did not keep them.
        self._backing, self._vouches = float(header.get("backing", math.nan)), bool(header.get("vouches", True))
        self._set, self.memory, self._shared, self._answer = kept, memory, shared, None

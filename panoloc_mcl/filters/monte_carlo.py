"""Monte Carlo localization over (x, y, heading) with proposals drawn from the vote field.

Propagate, recover, reweight, resample, estimate (Thrun, Burgard & Fox, "Probabilistic Robotics", chapter 8). Recovery is augmented
MCL with sensor-based proposals instead of blind ones (Lenser & Veloso 2000; "dual" sampling, Thrun et al. 2001): two averages tell
how well images fit the belief, and when the fast one falls below the slow one, particles are drawn from the image itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.config.localizer import MonteCarloSettings, StatusSettings
from panoloc_mcl.filters.base import Start
from panoloc_mcl.filters.blocks import BLOCK, Blocks
from panoloc_mcl.filters.clusters import find_clusters, grid_of
from panoloc_mcl.filters.estimate import Cluster, FilterState, Status
from panoloc_mcl.filters.resampling import SCHEMES, adaptive_count, effective_count, normalise, normalised
from panoloc_mcl.geometry import angle_difference, compose, inverse, wrap_angle
from panoloc_mcl.kernels.particles import propagate
from panoloc_mcl.kernels.resampling import taken
from panoloc_mcl.motion import Motion
from panoloc_mcl.observation.field import VoteField
from panoloc_mcl.observation.places import Places

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

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
        self._weigh_alike()
        self._nothing_known = start.position is None or start.heading is None
        self._has_converged = False
        self._match = math.nan
        self._match_slow = self._match_fast = math.nan
        self._fit = math.nan
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
        self.log_weights, self.weights = np.zeros(len(self.poses)), np.full(len(self.poses), 1.0 / len(self.poses))

    def _drawn_from(self, start: Start) -> Float64:
        rng, count = self._next_step(), self.settings.particles
        poses = np.empty((3, count)).T
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
        if motion.stands:
            return
        self._step += 1
        parts = (motion.first_turn, motion.along, motion.across, motion.last_turn)
        noise = (motion.sd_first_turn, motion.sd_along, motion.sd_across, motion.sd_last_turn)
        particles = self.poses.T

        def move(block: slice) -> None:
            particles[:, block] = propagate(particles, *parts, *noise, self._key, self._step, block.start, block.stop)

        self._blocks.each(move, len(self.poses))

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
            For a late image: the motion from the particles' time to the image's. The particles are weighed where they were then.
        """
        self._votes, self._resampled, self._injected = votes, False, 0
        if not votes.informative:
            self._match = math.nan
            return
        rng = self._next_step()
        likelihood = self._field_likelihood(votes, offset)
        self._judge(likelihood)
        self._recover(votes, offset, likelihood, rng)
        self._reweight(votes, offset, likelihood)
        self._judge_posterior(likelihood)
        del likelihood
        self._resample(rng)

    def _seen_from(self, poses: Float64, offset: Motion | None) -> Float64:
        return poses if offset is None else compose(poses, offset.increment)

    def _field_likelihood(self, votes: VoteField, offset: Motion | None, chosen: Int64 | None = None) -> Float64:
        """Relative to the field's best cell, so 1 at most (but for interpolation), and at least the floor."""
        poses = self.poses if chosen is None else self.poses[chosen]
        out = np.empty(len(poses))
        floor = max(self.settings.floor, votes.doubt)

        def weigh(block: slice) -> None:
            likelihood = votes.log_likelihood(votes.read(self._seen_from(poses[block], offset)))
            np.exp(likelihood, out=likelihood)
            likelihood *= 1.0 - floor
            likelihood += floor
            out[block] = likelihood

        # What every block needs is worked out once, before threads meet it.
        _ = votes.peak, votes.places.raster
        self._blocks.each(weigh, len(poses))
        return out

    def _judge(self, likelihood: Float64) -> None:
        """How much of the best cell's likelihood the prediction explains, now and in the running averages."""
        self._match = self._explained(likelihood)
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
        fit = self._explained(likelihood)
        self._fit = fit if math.isnan(self._fit) else self._fit + self.settings.recovery.fast * (fit - self._fit)

    def _explained(self, likelihood: Float64) -> float:
        blocks = [slice(start, start + BLOCK) for start in range(0, len(self.weights), BLOCK)]
        return float(sum(self.weights[block] @ likelihood[block] for block in blocks))

    def _recover(self, votes: VoteField, offset: Motion | None, likelihood: Float64, rng: np.random.Generator) -> None:
        """Replace a share of the particles by poses drawn from the image; all are weighed alike afterwards."""
        share = self._injection_share()
        count = int(share * len(self.poses))
        if count > 0:
            self._inject(votes.sample(count, rng), share, votes, offset, likelihood, rng)
        measurement = votes.measurement
        if measurement is not None:
            # The measured pose is far sharper than the particles are dense: without some at it, none would ever meet it.
            measured_share = self.settings.measured_share
            count = int(measured_share * len(self.poses))
            drawn = rng.multivariate_normal(measurement.pose, measurement.covariance, count, method="cholesky")
            drawn[:, 2] = wrap_angle(drawn[:, 2])
            # Where the belief is not, they weigh no more than the chance that the robot was carried there.
            expected = min(1.0, self._mass_near(measurement.pose, offset) + share)
            self._inject(drawn, measured_share * expected, votes, offset, likelihood, rng)

    def _inject(
        self,
        drawn: Float64,
        mass: float,
        votes: VoteField,
        offset: Motion | None,
        likelihood: Float64,
        rng: np.random.Generator,
    ) -> None:
        """Put poses at the image's time in the place of as many others, with a total weight of ``mass``."""
        count, others = len(drawn), len(self.poses)
        if count == 0:
            return
        if offset is not None:
            # The image says where the robot was; bring its poses on to the particles' time.
            drawn = compose(drawn, inverse(offset.increment))
        # Evenly spread over all from a random start: like particles lie next to each other, so none of a kind goes altogether.
        replaced = (np.arange(count) * others // count + int(rng.integers(others))) % others
        kept = max(1.0 - mass, _TINY)
        # The log-weights of the others stay as they are; those of the drawn are measured against them.
        scale = float(self.log_weights.max()) - math.log(float(self.weights.max()) * kept)
        self.log_weights[replaced] = scale + math.log(max(mass / count, _TINY))
        self.weights *= kept
        self.weights[replaced] = mass / count
        self.poses[replaced] = drawn
        likelihood[replaced] = self._field_likelihood(votes, offset, replaced)
        self._injected += count

    def _mass_near(self, pose: Float64, offset: Motion | None) -> float:
        """Share of the belief within the limits of convergence around a pose."""
        limits = self.status_settings
        seen_from = self._seen_from(self.poses, offset)
        near = np.hypot(seen_from[:, 0] - pose[0], seen_from[:, 1] - pose[1]) < limits.converged_spread_m
        near &= np.abs(angle_difference(seen_from[:, 2], pose[2])) < np.radians(limits.converged_spread_deg)
        return float(self.weights[near].sum() / self.weights.sum())

    def _injection_share(self) -> float:
        recovery = self.settings.recovery
        if self._nothing_known:
            self._nothing_known = False
            return recovery.max_share
        fallen = 1.0 - self._match_fast / self._match_slow if self._match_slow > 0.0 else 1.0
        share = min(max(fallen, recovery.min_share), recovery.max_share)
        if fallen > 0.5 and share > recovery.min_share:
            # The burst is on its way; judge it afresh instead of injecting for as long as the averages remember.
            self._match_fast = self._match_slow
        return share

    def _reweight(self, votes: VoteField, offset: Motion | None, likelihood: Float64) -> None:
        """Multiply the weights by the likelihood: that of the vote field, and of the measured pose where there is one."""
        if max(self.settings.floor, votes.doubt) == 0.0:
            # Far from the best cell there may be nothing left; a logarithm must stay finite.
            likelihood = np.maximum(likelihood, _TINY)
        self.log_weights += np.log(likelihood)
        if votes.measurement is not None:
            doubt = max(self.settings.measured_doubt, votes.doubt)
            fit = votes.measurement.relative_likelihood(self._seen_from(self.poses, offset))
            self.log_weights += np.log(doubt + (1.0 - doubt) * fit)
        normalise(self.log_weights, self.weights)

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
        status = self._status_of(clusters)
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

    def _status_of(self, clusters: tuple[Cluster, ...]) -> Status:
        limits = self.status_settings
        best = clusters[0]
        compact = best.spread_m < limits.converged_spread_m and best.spread_deg < limits.converged_spread_deg
        if best.mass > limits.converged_mass and compact:
            if self._has_converged and self._fit < limits.lost_match:
                return Status.LOST
            self._has_converged = True
            return Status.CONVERGED
        if sum(cluster.mass > limits.ambiguous_mass for cluster in clusters) >= 2:
            return Status.AMBIGUOUS
        return Status.LOST if self._has_converged and self._fit < limits.lost_match else Status.SEARCHING


# Of the filter, besides the particles.
_REMEMBERED = (
    "_key",
    "_step",
    "_nothing_known",
    "_has_converged",
    "_match",
    "_match_slow",
    "_match_fast",
    "_fit",
    "_place_votes",
    "_effective",
    "_resampled",
    "_injected",
)

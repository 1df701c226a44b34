"""Monte Carlo localization over (x, y, heading) with proposals drawn from the vote field.

Propagate, recover, reweight, resample, estimate (Thrun, Burgard & Fox, "Probabilistic Robotics", chapter 8). Recovery is augmented
MCL with sensor-based proposals instead of blind ones (Lenser & Veloso 2000; "dual" sampling, Thrun et al. 2001): two averages tell
how well images fit the belief, and when the fast one falls below the slow one, particles are drawn from the image itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.config.model import MonteCarloSettings, StatusSettings
from panoloc_mcl.filters.base import Start
from panoloc_mcl.filters.clusters import find_clusters
from panoloc_mcl.filters.estimate import Cluster, FilterState, Status
from panoloc_mcl.geometry import angle_difference, compose, inverse, wrap_angle
from panoloc_mcl.kernels.particles import propagate, systematic_resample
from panoloc_mcl.motion import Motion
from panoloc_mcl.observation.field import VoteField
from panoloc_mcl.observation.places import Places

Float64 = NDArray[np.float64]


class MonteCarloFilter:
    """Particles over position and heading.

    Parameters
    ----------
    places : Places
        Of the map: where a robot can be.
    start : Start
    settings : MonteCarloSettings
    status : StatusSettings
    rng : numpy.random.Generator
        The only source of randomness.
    """

    def __init__(
        self, places: Places, start: Start, settings: MonteCarloSettings, status: StatusSettings, rng: np.random.Generator
    ) -> None:
        self.places = places
        self.settings = settings
        self.status_settings = status
        self._rng = rng
        self.poses = self._drawn_from(start)
        self.log_weights = np.zeros(settings.particles)
        self._nothing_known = start.position is None or start.heading is None
        self._has_converged = False
        self._match = math.nan
        self._match_slow = self._match_fast = math.nan
        self._fit = math.nan
        self._votes: VoteField | None = None
        self._effective = float(settings.particles)
        self._resampled = False
        self._injected = 0

    def _drawn_from(self, start: Start) -> Float64:
        count = self.settings.particles
        poses = np.empty((count, 3))
        if start.position is None:
            poses[:, :2] = self.places.sample_uniform(count, self._rng)
        else:
            poses[:, :2] = np.asarray(start.position) + self._rng.normal(0.0, start.sd_position, (count, 2))
        if start.heading is None:
            poses[:, 2] = self._rng.uniform(-np.pi, np.pi, count)
        else:
            poses[:, 2] = wrap_angle(start.heading + self._rng.normal(0.0, start.sd_heading, count))
        return poses

    def propagate(self, motion: Motion) -> None:
        """Move every particle by odometry with noise; without motion nothing changes at all."""
        if motion.distance == motion.turn == motion.sd_position == motion.sd_heading == 0.0:
            return
        normals = self._rng.standard_normal((len(self.poses), 3))
        dx, dy, turn = (float(value) for value in motion.increment)
        self.poses = propagate(self.poses, dx, dy, turn, motion.sd_position, motion.sd_heading, normals)

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
        self._judge(self._field_log_likelihood(votes, offset))
        self._recover(votes, offset)
        self._reweight(votes, offset)
        self._judge_posterior(votes, offset)
        self._resample()

    def _seen_from(self, offset: Motion | None) -> Float64:
        return self.poses if offset is None else compose(self.poses, offset.increment)

    def _field_log_likelihood(self, votes: VoteField, offset: Motion | None) -> Float64:
        """Relative to the field's best cell, so 0 at most (but for interpolation); the floor keeps it finite."""
        relative = votes.log_likelihood(votes.read(self._seen_from(offset)))
        floor = self.settings.floor
        if floor == 0.0:
            # Far from the best cell exp() is 0; its logarithm must stay finite.
            return relative
        return np.asarray(np.log((1.0 - floor) * np.exp(relative) + floor))

    def _judge(self, log_likelihood: Float64) -> None:
        """How much of the best cell's likelihood the prediction explains, now and in the running averages."""
        self._match = float(self._weights() @ np.exp(log_likelihood))
        if math.isnan(self._match_slow):
            self._match_slow = self._match_fast = self._match
            return
        recovery = self.settings.recovery
        self._match_slow += recovery.slow * (self._match - self._match_slow)
        self._match_fast += recovery.fast * (self._match - self._match_fast)

    def _judge_posterior(self, votes: VoteField, offset: Motion | None) -> None:
        """Running share of the best votes that the belief explains once it has seen the image: low where images do not fit it.

        Before the image a wide belief explains little, too, for instance after a long way without images.
        """
        fit = float(self._weights() @ np.exp(self._field_log_likelihood(votes, offset)))
        self._fit = fit if math.isnan(self._fit) else self._fit + self.settings.recovery.fast * (fit - self._fit)

    def _recover(self, votes: VoteField, offset: Motion | None) -> None:
        """Replace a share of the particles by poses drawn from the image; all are weighed alike afterwards."""
        share = self._injection_share()
        self._inject(votes.sample(int(share * len(self.poses)), self._rng), share, offset)
        measurement = votes.measurement
        if measurement is not None:
            # The measured pose is far sharper than the particles are dense: without some at it, none would ever meet it.
            measured_share = self.settings.measured_share
            drawn = self._rng.multivariate_normal(
                measurement.pose, measurement.covariance, int(measured_share * len(self.poses)), method="cholesky"
            )
            drawn[:, 2] = wrap_angle(drawn[:, 2])
            # Where the belief is not, they weigh no more than the chance that the robot was carried there.
            expected = min(1.0, self._mass_near(measurement.pose, offset) + share)
            self._inject(drawn, measured_share * expected, offset)

    def _inject(self, drawn: Float64, mass: float, offset: Motion | None) -> None:
        """Put poses at the image's time in the place of as many random particles, with a total weight of ``mass``."""
        count = len(drawn)
        if count == 0:
            return
        if offset is not None:
            # The image says where the robot was; bring its poses on to the particles' time.
            drawn = compose(drawn, inverse(offset.increment))
        replaced = self._rng.choice(len(self.poses), count, replace=False)
        weights = self._weights() * (1.0 - mass)
        weights[replaced] = mass / count
        self.poses = self.poses.copy()
        self.poses[replaced] = drawn
        self.log_weights = np.log(np.maximum(weights, np.finfo(np.float64).tiny))
        self._injected += count

    def _mass_near(self, pose: Float64, offset: Motion | None) -> float:
        """Share of the belief within the limits of convergence around a pose."""
        limits = self.status_settings
        seen_from = self._seen_from(offset)
        near = np.hypot(seen_from[:, 0] - pose[0], seen_from[:, 1] - pose[1]) < limits.converged_spread_m
        near &= np.abs(angle_difference(seen_from[:, 2], pose[2])) < np.radians(limits.converged_spread_deg)
        return float(self._weights()[near].sum())

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

    def _weights(self) -> Float64:
        weights = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(weights / weights.sum())

    def _reweight(self, votes: VoteField, offset: Motion | None) -> None:
        """Multiply the weights by the likelihood: that of the vote field, and of the measured pose where there is one."""
        self.log_weights = self.log_weights + self._field_log_likelihood(votes, offset)
        if votes.measurement is not None:
            doubt = self.settings.measured_doubt
            fit = votes.measurement.relative_likelihood(self._seen_from(offset))
            self.log_weights += np.log(doubt + (1.0 - doubt) * fit)
        self.log_weights -= self.log_weights.max()

    def _resample(self) -> None:
        weights = self._weights()
        self._effective = float(1.0 / np.sum(weights * weights))
        if self._effective < self.settings.resample_below * len(weights):
            self.poses = self.poses[systematic_resample(weights, self._rng.random(), len(weights))]
            self.log_weights = np.zeros(len(weights))
            self._resampled = True

    def state(self) -> FilterState:
        """Clusters, status and the figures behind it."""
        clusters = find_clusters(self.poses, self._weights())
        best = clusters[0]
        status = self._status_of(clusters)
        place = self.places.nearest_reference(best.pose[:2])
        place_votes = math.nan
        if self._votes is not None and self._votes.informative:
            place_votes = float(self._votes.read(best.pose[None])[0])
        return FilterState(
            clusters=clusters,
            status=status,
            match=self._match,
            best_place=place,
            best_place_votes=place_votes,
            particle_count=len(self.poses),
            injected=self._injected,
            effective_count=self._effective,
            resampled=self._resampled,
        )

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

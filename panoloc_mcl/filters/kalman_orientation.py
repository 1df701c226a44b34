"""The paper's localizer: a Kalman filter on the heading, headings drawn from its prediction, the best response wins.

Steinbauer & Bischof (2004), section 3. The position is that of the reported place; there is no belief over positions. Odometry
turns the predicted heading, an image measures it. Measurements carry their own time stamps: a late image's heading is brought to the
filter's time by the odometry in between.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.config.model import KalmanSettings, StatusSettings
from panoloc_mcl.filters.base import Start
from panoloc_mcl.filters.estimate import Cluster, FilterState, Status
from panoloc_mcl.geometry import angle_difference, wrap_angle
from panoloc_mcl.motion import Motion
from panoloc_mcl.observation.field import VoteField
from panoloc_mcl.observation.places import Places

Float64 = NDArray[np.float64]

# Of a heading of which nothing is known: that of the uniform distribution over the circle.
_SD_UNKNOWN = math.pi / math.sqrt(3.0)


class KalmanOrientationFilter:
    """Heading by a Kalman filter, place by the best response.

    Parameters
    ----------
    places : Places
    start : Start
        The paper needs the heading; without one the first draws are from all around the circle.
    settings : KalmanSettings
    status : StatusSettings
    rng : numpy.random.Generator
    """

    def __init__(
        self, places: Places, start: Start, settings: KalmanSettings, status: StatusSettings, rng: np.random.Generator
    ) -> None:
        self.places = places
        self.settings = settings
        self.status_settings = status
        self._rng = rng
        self.heading = 0.0 if start.heading is None else float(wrap_angle(start.heading))
        self.sd_heading = _SD_UNKNOWN if start.heading is None else start.sd_heading
        self._place = 0 if start.position is None else int(places.nearest(np.array([start.position]))[0])
        self._place_known = False
        self._has_converged = False
        self._place_votes = math.nan
        self._match = math.nan

    def propagate(self, motion: Motion) -> None:
        """Predict the heading from odometry."""
        self.heading = float(wrap_angle(self.heading + motion.increment[2]))
        self.sd_heading = min(math.hypot(self.sd_heading, motion.sd_heading), _SD_UNKNOWN)

    def heading_hypotheses(self, offset: Motion | None) -> Float64:
        """M headings drawn from the predictive distribution at the image's time."""
        turn = 0.0 if offset is None else float(offset.increment[2])
        sd = max(self.sd_heading, math.radians(self.settings.min_sd_deg))
        return wrap_angle(self.heading + turn + sd * self._rng.standard_normal(self.settings.headings))

    def update(self, votes: VoteField, offset: Motion | None = None) -> None:
        """Take the heading and the place of the highest vote as this image's measurement; the place alone if it gives no heading."""
        if not votes.informative or votes.peak.votes <= 0.0:
            self._place_votes = self._match = math.nan
            return
        peak = votes.peak
        self._place, self._place_votes, self._place_known = peak.place, peak.votes, True
        if not votes.gives_heading:
            self._match = math.nan
            return
        turn = 0.0 if offset is None else float(offset.increment[2])
        measured = peak.heading - turn
        residual = float(angle_difference(measured, self.heading))
        variance = self.sd_heading**2
        noise = math.radians(self.settings.measurement_noise_deg) ** 2
        gain = variance / (variance + noise)
        self._match = math.exp(-0.5 * residual**2 / (variance + noise))
        self.heading = float(wrap_angle(self.heading + gain * residual))
        self.sd_heading = math.sqrt((1.0 - gain) * variance)

    def state(self) -> FilterState:
        """The reported place with the filtered heading, as one cluster."""
        position = self.places.positions[self._place]
        # Somewhere in the place's cell: a uniform distribution over one spacing.
        sd_position = self.places.spacing / math.sqrt(12.0)
        if not self._place_known:
            extent = np.ptp(self.places.positions, axis=0).max() if len(self.places) > 1 else self.places.spacing
            sd_position = float(extent) / math.sqrt(12.0)
        cluster = Cluster(
            np.array([position[0], position[1], self.heading]),
            np.diag([sd_position**2, sd_position**2, self.sd_heading**2]),
            1.0,
        )
        limits = self.status_settings
        if self._place_known and cluster.spread_deg < limits.converged_spread_deg:
            status = Status.CONVERGED
            self._has_converged = True
        else:
            status = Status.LOST if self._has_converged else Status.SEARCHING
        return FilterState(
            clusters=(cluster,),
            status=status,
            match=self._match,
            best_place=self.places.nearest_reference(position),
            best_place_votes=self._place_votes,
            particle_count=self.settings.headings,
            injected=0,
            effective_count=float(self.settings.headings),
            resampled=False,
        )

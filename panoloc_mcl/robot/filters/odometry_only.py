"""Dead reckoning: where odometry alone leads from the start. Images change nothing; it is what a comparison begins with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.base import Start
from panoloc_mcl.robot.filters.estimate import Cluster, FilterState, Status
from panoloc_mcl.robot.motion import Motion, carried
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.settings.localizer import StatusSettings

Float64 = NDArray[np.float64]

# Of a heading of which nothing is known: a uniform distribution over the circle.
_SD_UNKNOWN = math.pi / math.sqrt(3.0)

_FORM = "odometry_only/2"


class OdometryOnlyFilter:
    """A pose that odometry moves, and its covariance to first order.

    Parameters
    ----------
    places : Places
        Gives the middle of the map where the start's position is not known.
    start : Start
    status : StatusSettings

    Attributes
    ----------
    pose : float64 (3,)
        Metres and radians, map frame.
    covariance : float64 (3, 3)
    """

    def __init__(self, places: Places, start: Start, status: StatusSettings) -> None:
        self.places = places
        self.status_settings = status
        extent = np.ptp(places.positions, axis=0) + places.spacing
        position = places.positions.mean(axis=0) if start.position is None else start.position
        sd = extent / math.sqrt(12.0) if start.position is None else np.full(2, start.sd_position)
        sd_heading = _SD_UNKNOWN if start.heading is None else start.sd_heading
        self.pose = np.array([*position, start.heading or 0.0], dtype=np.float64)
        self.covariance = np.diag(np.array([*sd, sd_heading]) ** 2) if start.covariance is None else start.covariance.copy()

    def propagate(self, motion: Motion) -> None:
        """Move the pose; the covariance grows by the noise of each part of the motion."""
        self.pose, self.covariance = carried(self.pose, self.covariance, motion)

    def heading_hypotheses(self, offset: Motion | None) -> Float64:
        """The one heading that is believed: fewer votes cannot be asked for."""
        return np.array([self.pose[2] if offset is None else self.pose[2] + offset.increment[2]])

    def update(self, votes: VoteField, offset: Motion | None = None) -> None:
        """Take no notice."""

    def state(self) -> FilterState:
        """The pose as one cluster; converged as long as its spread is small enough."""
        cluster = Cluster(self.pose.copy(), self.covariance.copy(), 1.0)
        limits = self.status_settings
        sure = cluster.spread_m < limits.converged_spread_m and cluster.spread_deg < limits.converged_spread_deg
        return FilterState(
            clusters=(cluster,),
            status=Status.CONVERGED if sure else Status.SEARCHING,
            match=math.nan,
            best_place=self.places.nearest_reference(self.pose[:2]),
            best_place_votes=math.nan,
            particle_count=1,
            injected=0,
            effective_count=1.0,
            resampled=False,
        )

    def particles(self) -> tuple[Float64, Float64]:
        """None."""
        return np.zeros((0, 3)), np.zeros(0)

    def snapshot(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Pose and covariance."""
        return {"pose": self.pose, "covariance": self.covariance}, {"form": _FORM}

    def restore(self, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave.

        Raises
        ------
        KeyError, ValueError
            Something is missing, or of another shape.
        """
        if header.get("form") != _FORM:
            raise ValueError(f"the filter's state has the form {header.get('form')!r}, this version reads '{_FORM}'")
        pose, covariance = (np.asarray(arrays[name], dtype=np.float64) for name in ("pose", "covariance"))
        if pose.shape != (3,) or covariance.shape != (3, 3):
            raise ValueError(f"pose of shape {pose.shape}, covariance of shape {covariance.shape}")
        self.pose, self.covariance = pose.copy(), covariance.copy()

"""Filters: odometry and vote fields in, a belief about the pose out. They never see an image."""

from __future__ import annotations

from panoloc_mcl.robot.filters.base import PoseFilter, Start
from panoloc_mcl.robot.filters.estimate import Cluster, Estimate, FilterState, Status
from panoloc_mcl.robot.filters.kalman_orientation import KalmanOrientationFilter
from panoloc_mcl.robot.filters.monte_carlo import MonteCarloFilter
from panoloc_mcl.robot.filters.odometry_only import OdometryOnlyFilter
from panoloc_mcl.robot.filters.sightings import Sightings, telling_way

__all__ = [
    "Cluster",
    "Estimate",
    "FilterState",
    "KalmanOrientationFilter",
    "MonteCarloFilter",
    "OdometryOnlyFilter",
    "PoseFilter",
    "Sightings",
    "Start",
    "Status",
    "telling_way",
]

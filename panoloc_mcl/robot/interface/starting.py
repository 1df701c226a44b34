"""How a localizer begins: with what it is told of its pose, and in which filter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera import Mount
from panoloc_mcl.robot.errors import ConfigError, MeasurementError
from panoloc_mcl.robot.filters import Cluster, KalmanOrientationFilter, MonteCarloFilter, OdometryOnlyFilter, PoseFilter, Start
from panoloc_mcl.robot.motion import is_possible, planar_pose
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.settings.localizer import InitialPose, LocalizerSettings

Float64 = NDArray[np.float64]


def make_filter(settings: LocalizerSettings, places: Places, start: Start, rng: np.random.Generator) -> PoseFilter:
    """The filter of the chosen mode."""
    if settings.mode == "monte_carlo":
        return MonteCarloFilter(places, start, settings.monte_carlo, settings.status, rng)
    if settings.mode == "odometry_only":
        return OdometryOnlyFilter(places, start, settings.status)
    return KalmanOrientationFilter(places, start, settings.kalman_orientation, settings.status, rng)


def start_of(settings: LocalizerSettings, start_pose: tuple[float, float, float] | None, mount: Mount) -> Start:
    """What the settings say of the camera's pose at the start; what is given is the base's.

    Raises
    ------
    ConfigError, MeasurementError
        They ask for a start pose and there is none, or one that cannot be.
    """
    initial = settings.initial
    if isinstance(initial, InitialPose):
        x, y, heading = mount.camera_poses([initial.x, initial.y, math.radians(initial.heading_deg)]).tolist()
        return Start((x, y), heading, initial.sd_position_m, math.radians(initial.sd_heading_deg))
    if initial == "uniform":
        return Start()
    if start_pose is None:
        raise ConfigError(
            f"localizer.initial = {initial}: needs a start pose (a sequence with ground truth, or the argument start_pose); "
            "give a mapping x, y, heading_deg, or use uniform"
        )
    pose = planar_pose(start_pose, "start_pose")
    if not is_possible(pose):
        raise ConfigError(f"start_pose = {start_pose}: no robot can be there; give x, y in metres and the heading in radians")
    x, y, heading = mount.camera_poses(pose).tolist()
    return Start((x, y) if initial == "known_pose" else None, heading + math.radians(settings.initial_heading_error_deg))


def start_around(pose: ArrayLike, covariance: ArrayLike | None, mount: Mount) -> Start:
    """A pose of the base that somebody gives, (3,), with its covariance (3, 3); that of the default start pose if left out.

    Raises
    ------
    MeasurementError
        Not finite, of another shape, or a covariance that none can have.
    """
    if covariance is None:
        default = Start()
        covariance = np.diag([default.sd_position**2, default.sd_position**2, default.sd_heading**2])
    mean, spread = planar_pose(pose, "pose"), np.array(covariance, dtype=np.float64)
    if not is_possible(mean):
        raise MeasurementError(f"pose = {mean.tolist()}: no robot can be there; give x, y in metres and the heading in radians")
    if spread.shape != (3, 3) or not np.isfinite(spread).all() or not np.allclose(spread, spread.T, rtol=1e-6, atol=1e-12):
        raise MeasurementError("covariance: must be 3 x 3, symmetric and finite; give that of x, y and heading")
    if float(np.linalg.eigvalsh(spread).min()) < -1e-9 * max(float(np.trace(spread)), 1.0):
        raise MeasurementError("covariance: has a negative variance along some direction; give that of x, y and heading")
    of_camera = Cluster(mean, 0.5 * (spread + spread.T), 1.0).of_point(mount.offset)
    return Start.around(of_camera.pose, of_camera.covariance)

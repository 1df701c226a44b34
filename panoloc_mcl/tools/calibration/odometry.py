"""What a drive tells about where the camera sits on the base: its poses by the images against the base's by odometry (hand-eye)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference, between, interpolate_at

Float64 = NDArray[np.float64]

FEWEST_IMAGES = 8
# Errors of odometry grow with the way and the turn; images err by so much at least.
_ODOMETRY_SHARE, _IMAGE_M = 0.05, 0.003
_OUTLIER = 3.5
#: Not observable with a larger standard deviation: metres, radians, seconds.
OBSERVABLE_M, OBSERVABLE_RAD, OBSERVABLE_S = 0.05, np.radians(2.0), 0.05


@dataclass(frozen=True)
class Placement:
    """Where the camera sits, with standard deviations.

    Parameters
    ----------
    x_m, y_m, yaw : float
        Of the camera on the base; ``yaw`` is what the direction of travel adds to the heading that images gave, radians.
    sd_m, sd_yaw : float
    time_offset_s, sd_time_s : float
        To be added to the stamps of images.
    odometry_scale : float
        Metres of the map for a metre of odometry.
    images : int
    """

    x_m: float
    y_m: float
    yaw: float
    sd_m: float
    sd_yaw: float
    time_offset_s: float
    sd_time_s: float
    odometry_scale: float
    images: int


def place_camera(times: Float64, poses: Float64, odometry_times: Float64, odometry: Float64) -> Placement | None:
    """Find where the camera sits from poses of a drive.

    Parameters
    ----------
    times : float64 (n,)
        Of images, seconds.
    poses : float64 (n, 3)
        Where images say the camera was: metres and radians, map frame; the heading is the base's.
    odometry_times, odometry : float64 (m,) and (m, 3)
        Poses of the base in the odometry frame.

    Returns
    -------
    Placement or None
        None for fewer than `FEWEST_IMAGES` images.
    """
    if len(times) < FEWEST_IMAGES:
        return None
    offset, sd_time = _time_offset(times, poses, odometry_times, odometry)
    used = offset if sd_time <= OBSERVABLE_S else 0.0
    driven = interpolate_at(odometry_times, odometry, times + used)
    way = between(driven[:-1], driven[1:])
    first, second = (_turn(poses[part, 2]) for part in (slice(None, -1), slice(1, None)))
    moved = poses[1:, :2] - poses[:-1, :2]
    # Camera motion = scaled and turned way of the base + what its turn swings the camera by.
    a = np.einsum("kij,kj->ki", first, way[:, :2])
    b = np.einsum("kij,kj->ki", first, np.stack([-way[:, 1], way[:, 0]], axis=-1))
    design = np.concatenate([np.stack([a, b], axis=-1), second - first], axis=2).reshape(-1, 4)
    sd = np.hypot(_IMAGE_M * np.sqrt(2.0), _ODOMETRY_SHARE * np.hypot(way[:, 0], way[:, 1]))
    weight, right = np.repeat(1.0 / sd, 2), moved.reshape(-1)
    kept = np.ones(len(weight), dtype=np.bool_)
    for _ in range(4):
        w = weight * kept
        normal = (design * (w**2)[:, None]).T @ design + 1e-6 * np.eye(4)
        found = np.linalg.solve(normal, design.T @ (w**2 * right))
        rest = (right - design @ found) * weight
        usual = 1.4826 * float(np.median(np.abs(rest[kept])))
        kept = np.abs(rest) < _OUTLIER * max(usual, 0.3)
    variance = float((rest[kept] ** 2).sum()) / max(int(kept.sum()) - 4, 1)
    covariance = variance * np.linalg.inv(normal)
    scale = float(np.hypot(found[0], found[1]))
    sd_yaw = float(np.sqrt(covariance[1, 1])) / max(scale, 1e-6)
    sd_m = float(np.sqrt(max(covariance[2, 2], covariance[3, 3])))
    yaw = float(np.arctan2(found[1], found[0]))
    return Placement(float(found[2]), float(found[3]), yaw, sd_m, sd_yaw, offset, sd_time, scale, len(times))


def _time_offset(times: Float64, poses: Float64, odometry_times: Float64, odometry: Float64) -> tuple[float, float]:
    """Seconds to add to the stamps of images so that they turn when odometry does, and the standard deviation."""
    offset, sd = 0.0, np.inf
    small = 0.05
    for _ in range(4):
        at, before, after = (interpolate_at(odometry_times, odometry, times + offset + d)[:, 2] for d in (0.0, -small, small))
        rate = angle_difference(after, before) / (2.0 * small)
        rest = angle_difference(np.asarray(np.diff(np.unwrap(poses[:, 2]))), np.asarray(np.diff(np.unwrap(at))))
        change = np.diff(rate)
        kept = np.abs(rest) < _OUTLIER * max(1.4826 * float(np.median(np.abs(rest))), np.radians(0.2))
        information = float((change[kept] ** 2).sum())
        if information < 1e-9:
            return 0.0, np.inf
        step = float((change * rest)[kept].sum()) / information
        left = rest[kept] - change[kept] * step
        sd = float(np.sqrt((left**2).sum() / max(int(kept.sum()) - 1, 1) / information))
        offset += float(np.clip(step, -0.3, 0.3))
    return offset, sd


def _turn(heading: Float64) -> Float64:
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)

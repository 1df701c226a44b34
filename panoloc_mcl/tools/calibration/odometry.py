"""What a drive tells about where the camera sits on the base: its poses by the images against the base's by odometry (hand-eye)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag
from scipy.special import ndtr, stdtrit

from panoloc_mcl.robot.geometry import angle_difference, between, interpolate_at

Float64 = NDArray[np.float64]

FEWEST_IMAGES = 8
# Errors of wheels along the way and aside of it, as shares of it: where to begin, and the least; the rest of a drive tells them.
_SHARES, _LEAST_SHARE, _ROUNDS = (0.1, 0.03), 0.005, 6
# What a turn of a radian moves a base aside that odometry knows nothing of.
_SLIP_M = 0.003
# How far the speed's change between two messages takes an image off a straight line, of the most it can. An even change makes it a
# quarter, a jump while the image is taken makes it one; the drive tells which, and what is left is noise.
_BEND, _BEND_SD, _BEND_NOISE = 0.5, 0.5, 0.1
# How much of an error of the heading comes about by a metre, to that by a radian.
_DRIFT = 0.1
_IMAGE_M = 0.002
_OUTLIER, _MEDIAN_CHI2, _UNKNOWN = 3.5, 1.386, 1e4
#: A difference of the clocks is believed from so many standard deviations on.
LATE = 3.0
#: Not observable with a larger standard deviation: metres, radians, seconds.
OBSERVABLE_M, OBSERVABLE_RAD, OBSERVABLE_S = 0.05, np.radians(2.0), 0.05


@dataclass(frozen=True)
class Placement:
    """Where the camera sits, with standard deviations.

    Parameters
    ----------
    x_m, y_m, yaw : float
        Of the camera on the base; ``yaw`` is what the direction of travel adds to the heading that images gave, radians.
    sd_x_m, sd_y_m, sd_yaw : float
    time_offset_s, sd_time_s : float
        To be added to the stamps of images.
    odometry_scale : float
        Metres of the map for a metre of odometry.
    images : int
    """

    x_m: float
    y_m: float
    yaw: float
    sd_x_m: float
    sd_y_m: float
    sd_yaw: float
    time_offset_s: float
    sd_time_s: float
    odometry_scale: float
    images: int

    @property
    def sd_m(self) -> float:
        """The larger one of both positions."""
        return max(self.sd_x_m, self.sd_y_m)


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
    used = offset if sd_time <= OBSERVABLE_S and abs(offset) > LATE * sd_time else 0.0
    way, lengths, along, turned = _ways(times + used, poses[:, 2], odometry_times, odometry)
    turns = _turn(poses[:, 2])
    # Camera motion = scaled and turned way of the base + what its turn swings the camera by.
    aside = np.stack([-way[:, 1], way[:, 0]], axis=-1)
    bends, speeds = _bends(times + used, poses[:, 2], odometry_times, odometry)
    parts = np.stack([way, aside], axis=-1), turns[1:] - turns[:-1], -np.diff(bends, axis=0)[:, :, None]
    design = np.concatenate(parts, axis=2)
    prior = np.diag([0.0, 0.0, 0.0, 0.0, _BEND_SD**-2]) + 1e-6 * np.eye(5)
    moved = poses[1:, :2] - poses[:-1, :2]
    # The error of an image enters the way before it and the way after it.
    links = np.kron(np.diff(np.eye(len(times)), axis=0), np.eye(2))
    each = _IMAGE_M**2 * np.eye(2) + _BEND_NOISE**2 * speeds[:, :, None] * speeds[:, None, :]
    of_images = links @ block_diag(*each) @ links.T
    slip = (_SLIP_M * turned[:, None, None]) ** 2 * np.eye(2)
    kept, shares = np.ones(len(way), dtype=np.bool_), _SHARES
    for _ in range(_ROUNDS):
        spread = lengths[:, None, None] ** 2 * (shares[0] ** 2 * along + shares[1] ** 2 * (np.eye(2) - along)) + slip
        covariance = of_images.copy()
        for step in range(len(way)):
            at = slice(2 * step, 2 * step + 2)
            covariance[at, at] += spread[step] if kept[step] else _UNKNOWN * np.eye(2)
        root = np.linalg.cholesky(covariance)
        a, b = np.linalg.solve(root, design.reshape(-1, 5)), np.linalg.solve(root, moved.reshape(-1))
        normal = a.T @ a + prior
        found = np.linalg.solve(normal, a.T @ b + prior[:, 4] * _BEND)
        rest = moved - design @ found
        off = np.einsum("ki,kij,kj->k", rest, np.linalg.inv(spread + 2.0 * _IMAGE_M**2 * np.eye(2)), rest)
        kept = off < _OUTLIER**2 * max(float(np.median(off[kept])) / _MEDIAN_CHI2, 1.0)
        shares = _shares(rest[kept], way[kept], lengths[kept])
    variance = float(((b - a @ found) ** 2).sum()) / max(2 * int(kept.sum()) - 5, 1)
    error = variance * np.linalg.inv(normal)
    scale = float(np.hypot(found[0], found[1]))
    sd_yaw = float(np.sqrt(error[1, 1])) / max(scale, 1e-6)
    sd_x, sd_y = (float(np.sqrt(error[axis, axis])) for axis in (2, 3))
    yaw = float(np.arctan2(found[1], found[0]))
    return Placement(float(found[2]), float(found[3]), yaw, sd_x, sd_y, sd_yaw, offset, sd_time, scale, len(times))


def pooled(values: ArrayLike, sds: ArrayLike) -> tuple[float, float]:
    """Weighted mean of measurements and its standard deviation, larger where they differ by more than they claim (Birge ratio)."""
    value, sd = np.asarray(values, dtype=np.float64), np.asarray(sds, dtype=np.float64)
    weights = sd**-2.0
    if not weights.any():
        return float(value.mean()), np.inf
    mean = float(np.average(value, weights=weights))
    ratio = np.sqrt(float((weights * (value - mean) ** 2).sum()) / max(len(value) - 1, 1))
    return mean, float(weights.sum() ** -0.5 * max(1.0, ratio))


def _shares(rest: Float64, way: Float64, lengths: Float64) -> tuple[float, float]:
    """What odometry errs by along its way and aside of it, as shares of the way (standard deviations), as the rest has it."""
    driven = lengths > 0.02
    if driven.sum() < FEWEST_IMAGES:
        return _SHARES
    ahead = way[driven] / np.maximum(np.hypot(way[driven, 0], way[driven, 1]), 1e-9)[:, None]
    parts = (rest[driven] * ahead).sum(axis=1), rest[driven, 1] * ahead[:, 0] - rest[driven, 0] * ahead[:, 1]
    usual = [1.4826 * float(np.median(np.abs(part) / lengths[driven])) for part in parts]
    image = np.sqrt(2.0) * _IMAGE_M / float(np.median(lengths[driven]))
    first, second = (float(np.clip(np.sqrt(max(one**2 - image**2, 0.0)), _LEAST_SHARE, 0.5)) for one in usual)
    return first, second


def _ways(times: Float64, headings: Float64, odometry_times: Float64, odometry: Float64) -> tuple[Float64, ...]:
    """What the base drove between images, in the map's axes: its lengths by odometry, its directions by the headings of the images.

    Odometry's headings are mended where it turned, so that they meet those of the images. What is left is mostly an error of lengths.

    Returns
    -------
    way : float64 (n - 1, 2)
    lengths : float64 (n - 1,)
    along : float64 (n - 1, 2, 2)
        Mean projection onto the direction of travel.
    turned : float64 (n - 1,)
        By how much, to either side, radians.
    """
    inside = odometry_times[(odometry_times > times[0]) & (odometry_times < times[-1])]
    stamps = np.union1d(times, inside)
    driven = interpolate_at(odometry_times, odometry, stamps)
    steps = between(driven[:-1], driven[1:])
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    ends = np.searchsorted(stamps, times)
    # Errors of a heading come about by turns, some by the way, and a trifle by time.
    busy = np.concatenate([[0.0], np.cumsum(np.abs(steps[:, 2]) + _DRIFT * lengths + 1e-6 * np.diff(stamps))])
    off = np.unwrap(angle_difference(headings, driven[ends, 2]))
    heading = driven[:-1, 2] + np.interp(busy[:-1], busy[ends], off)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    way = np.add.reduceat(np.einsum("kij,kj->ki", _turn(heading), steps[:, :2]), ends[:-1])
    whole = np.add.reduceat(lengths, ends[:-1])
    weights = lengths + 1e-9
    along = np.add.reduceat(np.einsum("k,ki,kj->kij", weights, ahead, ahead), ends[:-1])
    turned = np.add.reduceat(np.abs(steps[:, 2]), ends[:-1])
    return way, whole, along / np.add.reduceat(weights, ends[:-1])[:, None, None], turned


def _bends(times: Float64, headings: Float64, odometry_times: Float64, odometry: Float64) -> tuple[Float64, Float64]:
    """How far a change of speed takes images off the straight line between messages at the most, and that change; (n, 2), map's axes.

    The most is a jump of the speed while the image is taken. Metres, and metres a message.
    """
    inner = np.searchsorted(odometry_times, times, side="right") - 1
    before = np.clip(inner, 1, max(len(odometry_times) - 3, 1))
    if len(odometry_times) < 4:
        return np.zeros((len(times), 2)), np.zeros((len(times), 2))
    spans = np.diff(odometry_times)
    speed = np.diff(odometry[:, :2], axis=0) / np.maximum(spans, 1e-9)[:, None]
    change = (speed[before + 1] - speed[before - 1]) * spans[before, None]
    off = angle_difference(headings, interpolate_at(odometry_times, odometry, times)[:, 2])
    change = np.einsum("kij,kj->ki", _turn(np.asarray(off)), change)
    share = np.clip((times - odometry_times[before]) / np.maximum(spans[before], 1e-9), 0.0, 1.0)
    return change * (share * (1.0 - share))[:, None], change


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
        left, freedom = rest[kept] - change[kept] * step, max(int(kept.sum()) - 1, 1)
        # Of few images the scatter is not known well (Student's t): as far out as so many standard deviations of many are.
        few = float(stdtrit(freedom, ndtr(LATE))) / LATE
        sd = few * float(np.sqrt((left**2).sum() / freedom / information))
        offset += float(np.clip(step, -0.3, 0.3))
    return offset, sd


def _turn(heading: Float64) -> Float64:
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)

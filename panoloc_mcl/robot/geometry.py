"""Poses in the plane and angles on the circle.

A pose is ``(x, y, theta)`` in metres and radians, axes as in ROS REP 103; arrays of poses have shape ``(..., 3)`` and dtype
float64. Angles are wrapped to ``[-pi, pi)``.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def wrap_angle(angle: ArrayLike) -> FloatArray:
    """Wrap angles to ``[-pi, pi)``.

    Parameters
    ----------
    angle : array_like of float
        Radians, any shape.

    Returns
    -------
    ndarray of float64, same shape
    """
    if isinstance(angle, float):
        # The same to the last bit, in a tenth of the time.
        return _wrapped(float(angle))
    a = np.asarray(angle, dtype=np.float64)
    inside = (a >= -np.pi) & (a < np.pi)
    if inside.all():
        return a.copy()
    wrapped = np.mod(a + np.pi, 2.0 * np.pi) - np.pi
    # np.mod may round up to the modulus itself, which would give +pi.
    wrapped = np.where(wrapped >= np.pi, -np.pi, wrapped)
    # What lies in the range stays as it is to the last bit, so that standing still is exactly that.
    return np.where(inside, a, wrapped)


def _wrapped(angle: float) -> FloatArray:
    if not -math.pi <= angle < math.pi:
        angle = (angle + math.pi) % (2.0 * math.pi) - math.pi
        if angle >= math.pi:
            angle = -math.pi
    return cast(FloatArray, np.float64(angle))


def angle_difference(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """The turn that leads from ``b`` to ``a``, in ``[-pi, pi)`` radians."""
    if isinstance(a, float) and isinstance(b, float):
        return _wrapped(float(a) - float(b))
    return wrap_angle(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64))


def circular_mean(angles: ArrayLike, weights: ArrayLike | None = None) -> float:
    """Direction of the (weighted) mean of unit vectors, radians in ``[-pi, pi)``.

    Undirected sets (resultant of length zero) have no mean; their result is arbitrary but finite.
    """
    a = np.asarray(angles, dtype=np.float64)
    w = np.ones_like(a) if weights is None else np.asarray(weights, dtype=np.float64)
    return float(wrap_angle(np.arctan2(np.sum(w * np.sin(a)), np.sum(w * np.cos(a)))))


def compose(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Pose ``b``, given in the frame of ``a``, in the frame that ``a`` is given in.

    Parameters
    ----------
    a, b : array_like of float, shape (..., 3)
        Broadcast against each other.

    Returns
    -------
    ndarray of float64, shape (..., 3)
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    # Filled and not stacked, which takes several times as long for a single pose.
    out = np.empty((*np.shape(x), 3))
    out[..., 0] = x
    out[..., 1] = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    out[..., 2] = wrap_angle(a[..., 2] + b[..., 2])
    return out


def inverse(a: ArrayLike) -> FloatArray:
    """The pose that undoes ``a``: ``compose(a, inverse(a))`` is the origin. Shape (..., 3)."""
    a = np.asarray(a, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], wrap_angle(-a[..., 2])],
        axis=-1,
    )


def between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Pose ``b`` as seen from ``a``: ``compose(a, between(a, b))`` is ``b``. Shape (..., 3)."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    # Differences first: equal poses give exactly the origin, and coordinates far from it lose nothing.
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    out = np.empty((*np.shape(dx), 3))
    out[..., 0], out[..., 1], out[..., 2] = c * dx + s * dy, c * dy - s * dx, angle_difference(b[..., 2], a[..., 2])
    return out


def interpolate(a: ArrayLike, b: ArrayLike, fraction: ArrayLike) -> FloatArray:
    """Poses on the way from ``a`` (fraction 0) to ``b`` (fraction 1), the heading along the shorter arc.

    Fractions outside [0, 1] extrapolate. Shapes broadcast; the result has shape (..., 3).
    """
    a, b = np.broadcast_arrays(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64))
    f = np.asarray(fraction, dtype=np.float64)
    turn = angle_difference(b[..., 2], a[..., 2])
    return np.stack(
        [
            a[..., 0] + f * (b[..., 0] - a[..., 0]),
            a[..., 1] + f * (b[..., 1] - a[..., 1]),
            wrap_angle(a[..., 2] + f * turn),
        ],
        axis=-1,
    )


def fitted_motion(a: ArrayLike, b: ArrayLike, least_outlying_m: float = 0.3) -> FloatArray:
    """The rigid motion that brings most positions of poses ``a`` nearest to those of ``b``: ``compose(motion, a)`` is about ``b``.

    Parameters
    ----------
    a, b : array_like of float, shape (n, 3)
        Poses; from the second of five rounds on, those that are farther off than five times the median have no say.
    least_outlying_m : float
        Nearer ones always have.

    Returns
    -------
    ndarray of float64, shape (3,)
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    near = np.ones(len(a), dtype=np.bool_)
    motion = np.zeros(3)
    for _ in range(5):
        x, y = a[near, :2], b[near, :2]
        p, q = x - x.mean(axis=0), y - y.mean(axis=0)
        turn = float(np.arctan2(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), np.sum(p * q)))
        moved = compose([0.0, 0.0, turn], [*x.mean(axis=0), 0.0])
        motion = np.array([*(y.mean(axis=0) - moved[:2]), turn])
        away = np.hypot(*(compose(motion, a) - b)[:, :2].T)
        near = away <= max(least_outlying_m, 5.0 * float(np.median(away)))
    return motion


def yaw_from_quaternion(qx: ArrayLike, qy: ArrayLike, qz: ArrayLike, qw: ArrayLike) -> FloatArray:
    """Rotation about the vertical axis of unit quaternions, radians in ``[-pi, pi)``."""
    x, y, z, w = (np.asarray(q, dtype=np.float64) for q in (qx, qy, qz, qw))
    return wrap_angle(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def interpolate_at(times: FloatArray, poses: FloatArray, at: ArrayLike) -> FloatArray:
    """Poses of a trajectory at given times; the ends hold outside its range.

    Parameters
    ----------
    times : ndarray of float64, shape (n,)
        Strictly increasing, seconds.
    poses : ndarray of float64, shape (n, 3)
    at : array_like of float
        Seconds, any shape.

    Returns
    -------
    ndarray of float64, shape (*at.shape, 3)
    """
    t = np.clip(np.asarray(at, dtype=np.float64), times[0], times[-1])
    if len(times) == 1:
        return np.broadcast_to(poses[0], (*t.shape, 3)).copy()
    right = np.clip(np.searchsorted(times, t, side="right"), 1, len(times) - 1)
    left = right - 1
    fraction = (t - times[left]) / (times[right] - times[left])
    return interpolate(poses[left], poses[right], fraction)

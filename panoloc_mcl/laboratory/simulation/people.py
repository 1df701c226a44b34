"""People who walk about: a few upright cylinders each, hit by formula."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.tools.datasets.trajectory import Trajectory

FloatArray = NDArray[np.float64]

# Offset ahead and to the left, radius, bottom and top, share of the albedo: legs, body, arms, head.
_PARTS = (
    (0.0, 0.09, 0.08, 0.0, 0.85, 0.5),
    (0.0, -0.09, 0.08, 0.0, 0.85, 0.5),
    (0.0, 0.0, 0.19, 0.85, 1.45, 1.0),
    (0.0, 0.24, 0.055, 0.8, 1.42, 0.9),
    (0.0, -0.24, 0.055, 0.8, 1.42, 0.9),
    (0.0, 0.0, 0.1, 1.5, 1.75, 1.2),
)
_STRIDE_M = 0.25


@dataclass(frozen=True)
class Person:
    """Somebody.

    Parameters
    ----------
    position : (float, float)
    heading : float
        Radians.
    albedo : float
        Of what they wear.
    phase : float
        Of their step, radians.
    """

    position: tuple[float, float]
    heading: float
    albedo: float
    phase: float


class Walk:
    """A person's way through the scene.

    Parameters
    ----------
    path : Trajectory
    albedo : float
    """

    def __init__(self, path: Trajectory, albedo: float) -> None:
        self._path, self._albedo = path, albedo

    def at(self, time: float) -> Person:
        """Where they are at a time in seconds."""
        x, y, theta = self._path.at(time)
        return Person((float(x), float(y)), float(theta), self._albedo, 5.0 * time)


def hit_people(
    person: Person, origin: FloatArray, directions: FloatArray, distance: FloatArray
) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
    """Rays that meet a person before anything else.

    Parameters
    ----------
    person : Person
    origin : ndarray of float64, shape (3,)
    directions : ndarray of float64, shape (n, 3)
        Unit vectors.
    distance : ndarray of float64, shape (n,)
        To what they meet without the person.

    Returns
    -------
    rays : ndarray of int64, shape (k,)
    distance : ndarray of float64, shape (k,)
    normals : ndarray of float64, shape (k, 3)
    albedo : ndarray of float64, shape (k,)
    """
    to = np.array(person.position) - origin[:2]
    away = float(np.hypot(*to))
    # Only rays that pass within half a metre.
    level = np.hypot(directions[:, 0], directions[:, 1])
    cosine = (directions[:, 0] * to[0] + directions[:, 1] * to[1]) / np.maximum(level * away, 1e-9)
    near = np.flatnonzero(cosine > (math.cos(math.asin(min(1.0, 0.5 / max(away, 0.5)))) if away > 0.5 else -1.1))
    best = distance[near].copy()
    normals, albedo = np.zeros((len(near), 3)), np.zeros(len(near))
    d = directions[near]
    a = np.maximum(d[:, 0] ** 2 + d[:, 1] ** 2, 1e-12)
    c, s = math.cos(person.heading), math.sin(person.heading)
    for number, (ahead, left, radius, low, high, share) in enumerate(_PARTS):
        swing = ahead + (_STRIDE_M * math.sin(person.phase) * (1.0 if number == 0 else -1.0) if number < 2 else 0.0)
        centre = np.array(person.position) + np.array([c * swing - s * left, s * swing + c * left]) - origin[:2]
        b = d[:, 0] * centre[0] + d[:, 1] * centre[1]
        inside = b * b - a * (centre @ centre - radius * radius)
        t = (b - np.sqrt(np.maximum(inside, 0.0))) / a
        z = origin[2] + t * d[:, 2]
        met = (inside > 0.0) & (t > 1e-3) & (z >= low) & (z <= high) & (t < best)
        best[met] = t[met]
        outwards = (t[met, None] * d[met, :2] - centre) / radius
        normals[met] = np.column_stack([outwards, np.zeros(len(outwards))])
        albedo[met] = min(person.albedo * share, 0.9)
    found = np.flatnonzero(albedo > 0.0)
    return near[found], best[found], normals[found], albedo[found]

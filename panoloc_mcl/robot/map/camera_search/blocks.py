"""Least squares over many images: common unknowns of the camera, and unknowns of each image that drop out of the equations.

The unknowns of an image (the distance of the wall in every column, or its own pose) are eliminated from its normal equations (Schur's
complement), so that only those of the camera remain, as in bundle adjustment.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.map.camera_search.features import Features, slopes_of

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# Columns count where they agree, over a window around them, by this share of the upper quartile of all at the least.
_WINDOW_DEG, _SHARE = 21.0, 0.6
# Walls bend at points so far apart only. Features are smoothed: a wall of every column's own shows in none of them, and would
# grow more ragged with every step.
_WALL_DEG = 9.0
# Of the usual information about a wall's distance: points that see less keep theirs.
_DAMPING = 0.2
_LARGEST_LOG_STEP = 0.25


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations of one image for the camera's unknowns.

    Parameters
    ----------
    normal : float64 (n, n)
    right : float64 (n,)
        So that the step is their quotient.
    common, energy : float
        Inner product of image and views, and the mean of their squared norms: their quotient is the agreement.
    """

    normal: Float64
    right: Float64
    common: float
    energy: float


@dataclass(frozen=True, eq=False)
class Residual:
    """How an image and the views of it differ.

    Parameters
    ----------
    difference : complex64 (views, rows, columns)
        Image minus view, 0 where not both are usable.
    weight : bool, same shape
        Pixels that count.
    common, energy : float64 (columns,)
        Sums over views and rows.
    """

    difference: Complex64
    weight: Bool
    common: Float64
    energy: Float64


#: Views after a step up and a step down.
Sides = tuple[list[Features], list[Features]]


def residual(image: list[Features], views: list[Features]) -> Residual:
    """Differences between an image (once for every view) and views of it."""
    weight = np.stack([mine.usable & view.usable for mine, view in zip(image, views, strict=True)])
    first, second = np.stack([mine.z for mine in image]), np.stack([view.z for view in views])
    common = (weight * (first * second.conj()).real).sum(axis=(0, 1))
    energy = 0.5 * (weight * (np.abs(first) ** 2 + np.abs(second) ** 2)).sum(axis=(0, 1))
    return Residual((first - second) * weight, weight, common.astype(np.float64), energy.astype(np.float64))


def agreeing(found: Residual) -> Bool:
    """Columns where image and views show the same, bool (columns,); the others are hidden, or no floor and wall."""
    count = len(found.common)
    reach = max(1, round(0.5 * _WINDOW_DEG * count / 360.0))
    window = np.ones(2 * reach + 1)
    common, energy = (
        np.convolve(np.pad(part, reach, mode="wrap"), window, mode="valid") for part in (found.common, found.energy)
    )
    agreement = common / np.maximum(energy, 1e-9)
    return np.asarray(agreement >= _SHARE * np.quantile(agreement, 0.75))


def derivative(start: Residual, views: list[Features], flow: Float64 | None, sides: Sides | None, step: float) -> Complex64:
    """What a unit of an unknown of the camera changes in the difference, complex64 (views, rows, columns).

    It moves the image by ``flow`` and the views by what ``sides`` say. Both are taken of the views: where image and view do not agree
    yet, their derivatives have nothing to do with each other, and least squares would hardly move.
    """
    found = np.zeros_like(start.difference)
    if sides is not None:
        for at, (above, below) in enumerate(zip(*sides, strict=True)):
            both = above.usable & below.usable
            found[at] -= (above.z - below.z) * both / np.float32(2.0 * step)
    if flow is not None:
        for at, view in enumerate(views):
            across, along = slopes_of(view.z)
            found[at] += across * flow[0].astype(np.float32) + along * flow[1].astype(np.float32)
    return np.asarray(found * start.weight, dtype=np.complex64)


def without_walls(start: Residual, jacobian: Complex64, wall: Complex64, used: Bool) -> tuple[Equations, Float64, Float64]:
    """Equations of the camera's unknowns, the logarithm of every column's wall distance eliminated.

    Parameters
    ----------
    start : Residual
    jacobian : complex64 (n, views, rows, columns)
        Of the common unknowns (see `derivative`).
    wall : complex64 (views, rows, columns)
        Of the walls.
    used : bool (columns,)

    Returns
    -------
    Equations
    gain : float64 (columns,)
        Step of each wall when no common unknown moves.
    slope : float64 (n, columns)
        What a step of the common unknowns takes off that.
    """
    n, columns = len(jacobian), wall.shape[-1]
    everything = np.concatenate([wall[None], jacobian])
    products = np.empty((n + 1, n + 1, columns))
    for i in range(n + 1):
        for j in range(i + 1):
            products[i, j] = products[j, i] = _columns(everything[i], everything[j]) * used
    rest = np.stack([_columns(one, start.difference) for one in everything]) * used
    bends = _bends(columns)
    aa, ab, ar = bends.T @ (products[0, 0][:, None] * bends), products[1:, 0] @ bends, rest[0] @ bends
    held = np.diag(aa).copy()
    aa += (_DAMPING * np.median(held[held > 0.0]) if held.any() else 1.0) * np.eye(len(aa))
    slope = np.linalg.solve(aa, ab.T).T
    normal, right = products[1:, 1:].sum(axis=2) - slope @ ab.T, slope @ ar - rest[1:].sum(axis=1)
    return (
        Equations(normal, right, float(start.common[used].sum()), float(start.energy[used].sum())),
        bends @ np.clip(-np.linalg.solve(aa, ar), -_LARGEST_LOG_STEP, _LARGEST_LOG_STEP),
        slope @ bends.T,
    )


@cache
def _bends(columns: int) -> Float64:
    """What the walls of all columns, float64 (columns, points), take of points around the circle: lines between them."""
    points = max(4, round(360.0 / _WALL_DEG))
    apart = np.arange(columns)[:, None] * (points / columns) - np.arange(points)
    return np.asarray(np.maximum(1.0 - np.abs(apart - points * np.round(apart / points)), 0.0))


def without_pose(start: Residual, jacobian: Complex64, pose: Complex64, used: Bool) -> tuple[Equations, Float64, Float64]:
    """As `without_walls`, with the image's own pose (3,) eliminated instead; its step, and what the common ones take off it."""
    everything = np.concatenate([jacobian, pose])[..., used].reshape(len(jacobian) + 3, -1)
    real = np.concatenate([everything.real, everything.imag], axis=1).astype(np.float64)
    rest = start.difference[..., used].reshape(-1)
    r = np.concatenate([rest.real, rest.imag]).astype(np.float64)
    full, right = real @ real.T, -(real @ r)
    n = len(jacobian)
    aa = full[n:, n:] + 1e-9 * np.eye(3)
    inverse = np.linalg.inv(aa)
    normal = full[:n, :n] - full[:n, n:] @ inverse @ full[n:, :n]
    reduced = right[:n] - full[:n, n:] @ inverse @ right[n:]
    agreed = Equations(normal, reduced, float(start.common[used].sum()), float(start.energy[used].sum()))
    return agreed, inverse @ right[n:], inverse @ full[n:, :n]


def _columns(first: Complex64, second: Complex64) -> Float64:
    """Inner products of the columns, summed over views and rows."""
    return np.asarray((first.real * second.real + first.imag * second.imag).sum(axis=(0, 1)), dtype=np.float64)

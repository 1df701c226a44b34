"""Elimination of the walls' distances, against dense least squares."""

import numpy as np
import pytest

from panoloc_mcl.robot.map.camera_search.blocks import Residual, without_walls

VIEWS, ROWS, COLUMNS, UNKNOWNS = 2, 12, 90, 3
# Of the circle, at which walls bend.
POINTS = 40


def noise(rng, *shape):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def between_points() -> np.ndarray:
    """Lines between values at points around the circle, by NumPy's own interpolation: float64 (columns, points)."""
    at, columns = np.arange(POINTS) * (COLUMNS / POINTS), np.arange(COLUMNS)
    return np.stack([np.interp(columns, at, one, period=COLUMNS) for one in np.eye(POINTS)], axis=1)


def case(seed=0):
    rng = np.random.default_rng(seed)
    shape = (VIEWS, ROWS, COLUMNS)
    start = Residual(noise(rng, *shape), np.ones(shape, dtype=bool), np.ones(COLUMNS), np.ones(COLUMNS))
    return start, noise(rng, UNKNOWNS, *shape), noise(rng, *shape)


def test_steps_are_those_of_least_squares_over_camera_and_walls() -> None:
    start, jacobian, wall = case()
    used = np.arange(COLUMNS) < 60
    bends = between_points()
    of_walls = wall[..., None] * bends
    design = np.concatenate([np.moveaxis(jacobian, 0, -1), of_walls], axis=-1)[:, :, used].reshape(-1, UNKNOWNS + POINTS)
    rest = start.difference[:, :, used].reshape(-1)
    a = np.concatenate([design.real, design.imag]).astype(np.float64)
    b = np.concatenate([rest.real, rest.imag]).astype(np.float64)
    normal = a.T @ a
    held = np.diag(normal)[UNKNOWNS:]
    normal[UNKNOWNS:, UNKNOWNS:] += 0.2 * np.median(held[held > 0.0]) * np.eye(POINTS)
    expected = np.linalg.solve(normal, -a.T @ b)
    some, gain, slope = without_walls(start, jacobian, wall, used)
    step = np.linalg.solve(some.normal, some.right)
    assert step == pytest.approx(expected[:UNKNOWNS], rel=1e-3, abs=1e-5)
    assert gain - step @ slope == pytest.approx(bends @ expected[UNKNOWNS:], rel=1e-3, abs=1e-5)


def test_walls_keep_theirs_where_nothing_agrees() -> None:
    start, jacobian, wall = case(1)
    some, gain, slope = without_walls(start, jacobian, wall, np.zeros(COLUMNS, dtype=bool))
    assert not np.any(gain)
    assert not np.any(slope)
    assert not np.any(some.normal)


def test_what_differs_from_column_to_column_does_not_make_walls_ragged() -> None:
    """Smoothed features do not show it, so it would add up from step to step."""
    start, jacobian, wall = case(2)
    gain = without_walls(start, jacobian, wall, np.ones(COLUMNS, dtype=bool))[1]
    bends = between_points()
    assert gain == pytest.approx(bends @ np.linalg.lstsq(bends, gain, rcond=None)[0], abs=1e-6)

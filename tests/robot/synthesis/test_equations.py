"""Covariances by the pulls of sectors, against errors that are drawn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoloc_mcl.robot.synthesis.equations import Equations, Views, limit_of

SECTORS, COLUMNS = 30, 360


def drawn(rng: np.random.Generator, sd: np.ndarray) -> tuple[np.ndarray, Equations]:
    """A linear problem whose pixels err alike within a sector, as depths do: the error of its solution, and the equations there."""
    azimuth = 2.0 * np.pi * np.arange(COLUMNS) / COLUMNS
    jacobian = np.stack([np.sin(azimuth), -np.cos(azimuth), np.ones(COLUMNS), np.cos(azimuth), np.sin(azimuth)], axis=1)
    jacobian *= rng.uniform(0.5, 1.5, (COLUMNS, 1))
    # The tilt moves features otherwise than a step does.
    jacobian[:, 3:] *= rng.uniform(-1.0, 1.0, (COLUMNS, 1))
    errors = np.repeat(sd * rng.standard_normal(SECTORS), COLUMNS // SECTORS)
    normal = jacobian.T @ jacobian
    solution = np.linalg.solve(normal, jacobian.T @ errors)
    left = errors - jacobian @ solution
    pulls = (jacobian * left[:, None]).reshape(SECTORS, -1, 5).sum(axis=1)
    residual = float(left @ left)
    # Image and views agree to 0.9.
    columns = np.ones((3, 1, COLUMNS)) * np.array([0.9, 1.0, 1.0])[:, None, None]
    return solution[:3], Equations(normal, jacobian.T @ left, residual, COLUMNS, columns, pulls)


@pytest.mark.parametrize("uneven", [False, True])
def test_covariances_hold_for_errors_that_sectors_share(uneven: bool) -> None:
    rng = np.random.default_rng(2)
    sd = np.where(np.arange(SECTORS) < 6, 0.5, 0.05) if uneven else np.full(SECTORS, 0.1)
    trials = [drawn(rng, sd) for _ in range(400)]
    squares = np.mean([error**2 for error, _ in trials], axis=0)
    by_sectors = np.mean([np.diag(equations.covariance(5)) for _, equations in trials], axis=0)
    by_noise = np.mean([np.diag(equations.noise(5)) for _, equations in trials], axis=0)
    # Pixels that err alike are not so many independent ones; the mixture is as wrong by the share of them that it has.
    assert np.all(by_noise < 0.6 * squares)
    assert np.all(by_sectors > 0.5 * squares)
    assert np.all(by_sectors < 1.2 * squares)
    assert np.all(by_sectors > 1.3 * by_noise)


def test_few_sectors_say_nothing_of_their_scatter() -> None:
    _, equations = drawn(np.random.default_rng(0), np.full(SECTORS, 0.1))
    pulls = equations.pulls.copy()
    pulls[8:] = 0.0
    assert np.array_equal(equations._replace(pulls=pulls).covariance(5), equations.noise(5))


@pytest.mark.parametrize("unknowns", [3, 5])
def test_covariances_are_positive_definite_and_steps_bounded(unknowns: int) -> None:
    _, equations = drawn(np.random.default_rng(1), np.full(SECTORS, 0.1))
    for covariance in (equations.covariance(unknowns), equations.noise(unknowns)):
        assert np.linalg.eigvalsh(covariance).min() > 0.0
    far = equations._replace(right=np.full(5, 1e6))
    step = far.step(np.zeros(2), unknowns)
    assert np.hypot(*step[:2]) <= 0.15 + 1e-12
    assert abs(step[2]) <= np.radians(2.0) + 1e-12
    assert np.all(step[unknowns:] == 0.0)


def torn(apart: np.ndarray, weights: np.ndarray) -> Equations:
    """Equations of views, each of which alone would move the pose by a row of ``apart`` (v, 5)."""
    _, equations = drawn(np.random.default_rng(3), np.full(SECTORS, 1e-3))
    normals = np.repeat(equations.normal[None], len(weights), axis=0)
    rights = np.einsum("vij,vj->vi", normals, apart)
    return equations._replace(right=weights @ rights, views=Views(weights, normals, rights))


def test_views_that_contradict_each_other_are_not_believed() -> None:
    weights = np.array([0.4, 0.3, 0.2, 0.1])
    rng = np.random.default_rng(0)
    squares, claimed = [], []
    for _ in range(400):
        apart = np.zeros((4, 5))
        apart[:, :2] = 0.05 * rng.standard_normal((4, 2))
        squares.append((weights @ apart[:, :2]) ** 2)
        claimed.append(np.diag(torn(apart, weights).covariance(5))[:2])
    ratio = np.mean(claimed, axis=0) / np.mean(squares, axis=0)
    # Twice what errors make that views do not share, since they share some.
    assert np.all((ratio > 1.6) & (ratio < 2.6))
    assert not torn(0.05 * np.eye(4, 5), weights).settled(5)


def test_views_that_agree_add_nothing() -> None:
    weights = np.array([0.4, 0.3, 0.2, 0.1])
    together = torn(np.tile([0.01, 0.0, 0.0, 0.0, 0.0], (4, 1)), weights)
    assert np.allclose(together.covariance(5), together._replace(views=None).covariance(5), atol=1e-12)
    assert together.settled(5)
    single = torn(np.full((1, 5), 0.05), np.ones(1))
    assert np.allclose(single.covariance(5), single._replace(views=None).covariance(5))


def test_a_view_of_nothing_goes_nowhere_far() -> None:
    equations = torn(np.zeros((2, 5)), np.array([0.5, 0.5]))
    assert equations.views is not None
    empty = equations.views._replace(
        normals=np.stack([equations.normal, np.zeros((5, 5))]), rights=np.stack([np.zeros(5), np.full(5, 1e-3)])
    )
    covariance = equations._replace(views=empty).covariance(5)
    assert np.isfinite(covariance).all()
    assert np.sqrt(covariance[0, 0]) < 0.25


@given(st.floats(0.0, 0.6), st.floats(-np.pi, np.pi), st.floats(1e-4, 0.1))
def test_steps_that_shrink_evenly_are_followed_to_their_limit(shrinks: float, direction: float, length: float) -> None:
    before = length * np.array([np.cos(direction), np.sin(direction), 0.1, 0.01, -0.02])
    steps = before * np.power(shrinks, np.arange(1, 200))[:, None]
    assert np.allclose(limit_of(steps[0], before), steps.sum(axis=0), atol=1e-9 * length)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_steps_that_do_not_shrink_are_not_followed_far(along: float, across: float) -> None:
    before = np.array([0.01, 0.0, 0.001, 0.0, 0.0])
    step = np.array([0.01 * along, 0.01 * across, 0.001, 0.0, 0.0])
    stretch = float(np.linalg.norm(limit_of(step, before)) / np.linalg.norm(step))
    assert 1.0 <= stretch <= 2.5 + 1e-9
    if along <= 0.0:
        assert stretch == 1.0


def test_a_first_step_is_taken_as_it_is() -> None:
    step = np.array([0.01, -0.02, 0.001, 0.0, 0.0])
    assert np.array_equal(limit_of(step, np.zeros(5)), step)

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement


def a_measurement(seed: int, heading: float = 0.3) -> PoseMeasurement:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((3, 3)) * [[0.02], [0.03], [0.01]]
    pose = np.array([*rng.uniform(-5.0, 5.0, 2), heading])
    return PoseMeasurement(pose, root @ root.T + 1e-6 * np.eye(3), np.zeros(2), Agreement(0.9, np.full(24, 0.9), 0.9))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000))
def test_the_likelihood_is_a_gaussian_with_one_at_its_top(seed: int) -> None:
    measured = a_measurement(seed)
    rng = np.random.default_rng(seed + 1)
    poses = rng.multivariate_normal(measured.pose, measured.covariance, 50)
    gaussian = multivariate_normal(measured.pose, measured.covariance)
    expected = np.exp(gaussian.logpdf(poses) - gaussian.logpdf(measured.pose))
    assert measured.relative_likelihood(poses) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert measured.relative_likelihood(measured.pose[None]) == pytest.approx([1.0])


@pytest.mark.parametrize("heading", [-np.pi, np.nextafter(np.pi, 0.0), 3.1])
def test_headings_are_compared_on_the_circle(heading: float) -> None:
    measured = a_measurement(4, heading)
    offsets = np.array([[0.0, 0.0, step] for step in (-0.02, -0.005, 0.005, 0.02)])
    plain = measured.relative_likelihood(measured.pose + offsets)
    for turns in (-2, 1):
        assert measured.relative_likelihood(measured.pose + offsets + [0.0, 0.0, 2.0 * np.pi * turns]) == pytest.approx(plain)
    assert plain == pytest.approx(plain[::-1])


def test_far_away_it_is_zero_and_nothing_is_changed() -> None:
    measured = a_measurement(2)
    poses = np.array([[1e6, -1e6, 0.0], [0.0, 0.0, 50.0]])
    before = poses.copy()
    assert measured.relative_likelihood(poses) == pytest.approx([0.0, 0.0])
    assert np.array_equal(poses, before)
    assert measured.relative_likelihood(np.zeros((0, 3))).shape == (0,)

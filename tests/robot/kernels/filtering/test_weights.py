import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from panoloc_mcl.robot.kernels import elementary
from panoloc_mcl.robot.kernels.filtering import weights

either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200, deadline=None)


@either
@given(x=st.floats(-87.0, 88.0, width=32))
def test_the_exponential_is_that_of_numpy(variant, x: float) -> None:
    assert variant(elementary.exponential)(np.float32(x)) == pytest.approx(float(np.exp(x)), rel=2e-7)


@pytest.mark.parametrize("x", [-87.5, -104.0, -1e6, -np.inf])
def test_what_is_too_small_for_all_digits_is_zero(variant, x: float) -> None:
    with np.errstate(invalid="ignore", over="ignore"):
        assert variant(elementary.exponential)(np.float32(x)) == 0.0


def test_what_is_no_number_stays_none(variant) -> None:
    with np.errstate(invalid="ignore", over="ignore"):
        votes = np.array([0.5, np.nan], dtype=np.float32)
        assert np.isnan(variant(weights.likelihoods)(votes, 0.6, 0.1, 1.0, 0.1)).tolist() == [False, True]
        shares = np.array([0.5, np.nan], dtype=np.float32)
        variant(weights.scale)(shares, 2.0)
        assert np.isnan(shares).tolist() == [False, True]


@pytest.mark.parametrize(("sharpness", "floor"), [(1.0, 0.0), (0.3, 0.005), (1.0, 1.0)])
def test_likelihoods_agree_with_numpy(variant, sharpness: float, floor: float) -> None:
    votes = np.random.default_rng(1).random(500).astype(np.float32)
    short = np.maximum(0.8 - votes.astype(np.float64), 0.0) / 0.15
    expected = floor + (1.0 - floor) * np.exp(-0.5 * sharpness * short**2)
    # Exponents up to 14 in single precision.
    assert variant(weights.likelihoods)(votes, 0.8, 0.15, sharpness, floor) == pytest.approx(expected, rel=5e-6)


def test_likelihoods_of_very_sharp_images_are_zero_and_not_garbage(variant) -> None:
    votes = np.linspace(0.0, 1.0, 300).astype(np.float32)
    found = variant(weights.likelihoods)(votes, 1.0, 1e-3, 1.0, 0.0)
    assert found[-1] == 1.0
    assert (np.diff(found) >= 0.0).all()
    assert (found[:100] == 0.0).all()


def test_weighing_agrees_with_numpy(variant) -> None:
    rng = np.random.default_rng(2)
    some, fit = rng.random((2, 400)).astype(np.float32)
    weighed = some.copy()
    variant(weights.weigh)(weighed, fit, 3.0, 0.5)
    assert weighed == pytest.approx(some * (3.0 * fit.astype(np.float64) + 0.5), rel=1e-6)


def test_no_likelihood_at_all_leaves_the_least_weight(variant) -> None:
    some = np.array([0.0, 1e-45, 1.0], dtype=np.float32)
    variant(weights.scale)(some, 0.5)
    assert some.tolist() == [np.finfo(np.float32).tiny, np.finfo(np.float32).tiny, 0.5]


def test_the_normal_density_agrees_with_scipy(variant) -> None:
    rng = np.random.default_rng(3)
    root = np.tril(rng.standard_normal((3, 3))) + 2.0 * np.eye(3)
    mean = np.array([1.0, -2.0, 3.0])
    away = rng.uniform(-3.0, 3.0, (50, 3))
    turned = mean + away + np.array([0.0, 0.0, 2.0 * np.pi]) * rng.integers(-2, 3, (50, 1))
    scale = -1.5 * np.log(2.0 * np.pi) - np.log(np.diag(root)).sum()
    found = variant(weights.normal_density)(turned, mean, np.linalg.inv(root), float(scale))
    assert found == pytest.approx(multivariate_normal(np.zeros(3), root @ root.T).pdf(away), rel=1e-9)


@pytest.mark.parametrize("every", [1, 4])
def test_sums_over_headings_agree_with_numpy(variant, every: int) -> None:
    votes = np.random.default_rng(2).random((360, 37)).astype(np.float32)
    short = np.maximum(0.8 - votes[::every].astype(np.float64), 0.0) / 0.15
    expected = np.exp(-0.5 * 0.7 * short**2).sum(axis=0)
    assert variant(weights.sums_of_likelihoods)(votes, every, 0.8, 0.15, 0.7) == pytest.approx(expected, rel=5e-6)

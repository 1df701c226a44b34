import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.kernels import elementary, weights

either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200, deadline=None)


@either
@given(x=st.floats(-708.0, 709.0))
def test_the_exponential_is_that_of_numpy(variant, x: float) -> None:
    assert variant(elementary.exponential)(x) == pytest.approx(float(np.exp(x)), rel=1e-15)


@pytest.mark.parametrize("x", [-708.5, -745.0, -1e6, -np.inf])
def test_what_is_too_small_for_all_digits_is_zero(variant, x: float) -> None:
    with np.errstate(invalid="ignore"):
        assert variant(elementary.exponential)(x) == 0.0


def test_what_is_no_number_stays_none(variant) -> None:
    with np.errstate(invalid="ignore", over="ignore"):
        assert np.isnan(variant(elementary.exponential)(np.nan))
        votes = np.array([0.5, np.nan], dtype=np.float32)
        assert np.isnan(variant(weights.likelihoods)(votes, 0.6, 0.1, 1.0, 0.1)).tolist() == [False, True]
        log_weights, values = np.zeros(2), np.array([1.0, np.nan])
        assert np.isnan(variant(weights.reweighted)(log_weights, values, 0.0)).tolist() == [False, True]


@pytest.mark.parametrize(("sharpness", "floor"), [(1.0, 0.0), (0.3, 0.005), (1.0, 1.0)])
def test_likelihoods_agree_with_numpy(variant, sharpness: float, floor: float) -> None:
    votes = np.random.default_rng(1).random(500).astype(np.float32)
    short = np.maximum(0.8 - votes.astype(np.float64), 0.0) / 0.15
    expected = floor + (1.0 - floor) * np.exp(-0.5 * sharpness * short**2)
    assert variant(weights.likelihoods)(votes, 0.8, 0.15, sharpness, floor) == pytest.approx(expected, rel=1e-12)


def test_likelihoods_of_very_sharp_images_are_zero_and_not_garbage(variant) -> None:
    votes = np.linspace(0.0, 1.0, 300).astype(np.float32)
    found = variant(weights.likelihoods)(votes, 1.0, 1e-3, 1.0, 0.0)
    assert found[-1] == 1.0
    assert (np.diff(found) >= 0.0).all()
    assert (found[:100] == 0.0).all()


def test_reweighting_agrees_with_numpy(variant) -> None:
    rng = np.random.default_rng(2)
    log_weights, values = rng.normal(-5.0, 3.0, 400), rng.random(400) ** 20
    expected = log_weights + np.log(values) - 1.5
    assert variant(weights.reweighted)(log_weights, values, 1.5) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_no_likelihood_at_all_leaves_a_finite_log_weight(variant) -> None:
    assert variant(weights.reweighted)(np.zeros(1), np.zeros(1), 0.0) == pytest.approx(np.log(np.finfo(np.float64).tiny))


def test_exponentials_agree_with_numpy(variant) -> None:
    log_weights = -np.random.default_rng(3).exponential(50.0, 300)
    log_weights[:2] = 0.0, -np.inf
    with np.errstate(invalid="ignore"):
        assert variant(weights.exponentials)(log_weights) == pytest.approx(np.exp(log_weights), rel=1e-14)

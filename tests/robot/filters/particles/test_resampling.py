import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from panoloc_mcl.robot.filters.particles.resampling import SCHEMES, adaptive_count, effective_count, normalise
from panoloc_mcl.robot.settings.localizer import AdaptiveSettings


def normalised(values) -> np.ndarray:
    weights = np.array(values, dtype=np.float32)
    normalise(weights)
    return weights


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0.0, 1e6, width=32), min_size=1, max_size=50).filter(lambda w: sum(w) > 1e-6), st.floats(1e-3, 1e3))
def test_weights_are_shares_whatever_the_factor(values: list[float], factor: float) -> None:
    weights = normalised(values)
    assert weights.sum() == pytest.approx(1.0, rel=1e-5)
    # None is lost for good.
    assert np.all((weights > 0.0) & (weights <= 1.0 + 1e-6))
    assert normalised(np.array(values) * factor) == pytest.approx(weights, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_where_no_particle_has_any_weight_all_are_equal(bad: float) -> None:
    assert np.array_equal(normalised(np.full(8, bad)), np.full(8, 0.125))


def test_one_particle_without_weight_changes_nothing_for_the_others() -> None:
    assert normalised([1.0, 0.0, 1.0]) == pytest.approx([0.5, 0.0, 0.5])


def test_equal_weights_stay_exactly_equal() -> None:
    for value in (1.0, 1e-30, 1e30):
        weights = normalised(np.full(1000, value))
        assert np.ptp(weights) == 0.0
        assert effective_count(weights) == pytest.approx(1000.0, rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60).filter(lambda w: sum(w) > 1e-3))
def test_the_effective_count_lies_between_one_and_all(weights: list[float]) -> None:
    shares = np.array(weights) / np.sum(weights)
    assert 1.0 - 1e-9 <= effective_count(shares) <= len(shares)


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_schemes_are_known_by_name(scheme: str) -> None:
    drawn = SCHEMES[scheme](np.array([0.5, 0.0, 0.5]), 4, np.random.default_rng(0))
    assert len(drawn) == 4
    assert 1 not in drawn


@pytest.mark.parametrize("bins", [2, 3, 10, 100, 1000])
@pytest.mark.parametrize(("error", "quantile"), [(0.05, 0.99), (0.01, 0.9), (0.5, 0.999)])
def test_the_adaptive_count_is_that_of_fox(bins: int, error: float, quantile: float) -> None:
    wide = AdaptiveSettings(error=error, quantile=quantile, min_particles=10, max_particles=10_000_000)
    # The exact quantile; Wilson and Hilferty come near it.
    exact = stats.chi2.ppf(quantile, bins - 1) / (2.0 * error)
    assert adaptive_count(bins, wide) == pytest.approx(exact, rel=0.02, abs=11.0)


def test_the_adaptive_count_keeps_its_limits() -> None:
    limited = AdaptiveSettings(min_particles=100, max_particles=1000)
    assert [adaptive_count(bins, limited) for bins in (0, 1, 2, 100_000)] == [100, 100, 100, 1000]
    counts = [adaptive_count(bins, limited) for bins in range(1, 200)]
    assert counts == sorted(counts)

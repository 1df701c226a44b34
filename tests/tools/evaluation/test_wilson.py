import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from panoloc_mcl.tools.evaluation.wilson import wilson95

counts = st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts)
def test_contains_the_rate_and_stays_within_zero_and_one(count):
    successes, trials = count
    low, high = wilson95(successes, trials)
    assert 0.0 <= low <= successes / trials <= high <= 1.0


@given(counts)
def test_agrees_with_scipy(count):
    expected = binomtest(*count).proportion_ci(confidence_level=0.95, method="wilson")
    assert wilson95(*count) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_the_ends_are_exact():
    assert wilson95(0, 10)[0] == 0.0
    assert wilson95(10, 10)[1] == 1.0


def test_no_trials_have_no_interval():
    assert wilson95(0, 0) is None


@pytest.mark.parametrize(("successes", "trials"), [(-1, 10), (11, 10), (1, 0)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match="give 0 <= successes <= trials"):
        wilson95(successes, trials)

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats  # noqa: F401  slow to import, which is no test's fault

from panoloc_mcl.tools.evaluation.intervals import bootstrap95, interval95_over_drives, quantile95_over_drives, wilson95

counts = st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))
Z_95 = 1.959963984540054


def by_hand(successes, trials):
    """Wilson (1927): where the score test of a rate stops refusing it."""
    rate, z2 = successes / trials, Z_95**2
    centre, scale = rate + z2 / (2 * trials), 1 + z2 / trials
    half = Z_95 * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials * trials))
    return (centre - half) / scale, (centre + half) / scale


def known(interval: tuple[float, float] | None) -> tuple[float, float]:
    assert interval is not None
    return interval


@given(counts)
def test_contains_the_rate_and_stays_within_zero_and_one(count):
    successes, trials = count
    low, high = known(wilson95(successes, trials))
    assert 0.0 <= low <= successes / trials <= high <= 1.0


@given(counts)
def test_agrees_with_the_formula(count):
    assert wilson95(*count) == pytest.approx(by_hand(*count), abs=1e-9)


def test_the_ends_are_exact():
    assert wilson95(0, 10)[0] == 0.0
    assert wilson95(10, 10)[1] == 1.0


def test_no_trials_have_no_interval():
    assert wilson95(0, 0) is None
    assert interval95_over_drives([], []) is None
    assert interval95_over_drives([0, 0], [0, 0]) is None


@pytest.mark.parametrize(("successes", "trials"), [(-1, 10), (11, 10), (1, 0)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match="give 0 <= successes <= trials"):
        wilson95(successes, trials)


def test_seeds_over_the_same_drives_are_no_new_trials():
    once = interval95_over_drives([1] * 15, [1] * 15)
    assert interval95_over_drives([20] * 15, [20] * 15) == once == wilson95(15, 15)
    mixed = [1, 0, 1, 1, 0, 1, 1, 1]
    assert interval95_over_drives([50 * hit for hit in mixed], [50] * 8) == interval95_over_drives(mixed, [1] * 8)


@given(st.lists(st.integers(1, 40).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), min_size=1, max_size=12))
def test_over_drives_it_contains_the_rate(drives):
    hits, trials = zip(*drives, strict=True)
    low, high = known(interval95_over_drives(hits, trials))
    assert 0.0 <= low <= sum(hits) / sum(trials) + 1e-9
    assert sum(hits) / sum(trials) <= high + 1e-9 <= 1.0 + 2e-9


def test_drives_that_differ_widen_the_interval():
    # The same 50 %: every drive half and half, or half of the drives whole and the others not at all.
    rng = np.random.default_rng(0)
    alike = rng.binomial(40, 0.5, 12)
    low, high = known(interval95_over_drives(alike.tolist(), [40] * 12))
    wide_low, wide_high = known(interval95_over_drives([40, 0] * 6, [40] * 12))
    assert wide_high - wide_low > 3.0 * (high - low)


def test_a_single_drive_tells_nothing_of_others():
    assert bootstrap95([0.3]) == (-np.inf, np.inf)
    low, high = bootstrap95(np.random.default_rng(1).standard_normal(200))
    # Two standard errors of 200 normal values are 0.14.
    assert -0.3 < low < 0.0 < high < 0.3
    assert high - low == pytest.approx(4.0 / math.sqrt(200), rel=0.2)


def test_the_interval_of_a_median_covers_it_and_may_be_endless():
    low, high = known(quantile95_over_drives(np.arange(1.0, 100.0), np.arange(99)))
    assert 35.0 < low < 50.0 < high < 65.0
    assert known(quantile95_over_drives([1.0, np.inf, np.inf, np.inf, 2.0], range(5)))[1] == np.inf
    assert quantile95_over_drives(np.arange(400.0), np.arange(400) // 100) is None


def test_a_drive_counts_once_for_the_interval_of_a_median():
    values = np.random.default_rng(2).normal(size=9)
    once = quantile95_over_drives(values, np.arange(9))
    assert quantile95_over_drives(np.repeat(values, 40), np.repeat(np.arange(9), 40)) == once


@pytest.mark.slow
def test_intervals_of_medians_over_drives_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(0)
    held = []
    for _ in range(60):
        # Drives err by their own, and images hardly differ from their drive.
        values = np.repeat(rng.normal(size=12), 10) + rng.normal(0.0, 0.1, 120)
        low, high = known(quantile95_over_drives(values, np.arange(120) // 10))
        held.append(low <= 0.0 <= high)
    assert np.mean(held) > 0.85

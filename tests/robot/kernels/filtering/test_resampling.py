import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import kernels as naive

from panoloc_mcl.robot.kernels.filtering import resampling

# The fixture only picks a function.
either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)

SCHEMES = {
    "systematic": lambda variant, w, count, rng: variant(resampling.systematic)(w, rng.random(), count),
    "stratified": lambda variant, w, count, rng: variant(resampling.stratified)(w, rng.random(count)),
    "residual": lambda variant, w, count, rng: variant(resampling.residual)(w, rng.random(count)),
    "multinomial": lambda variant, w, count, rng: variant(resampling.multinomial)(w, rng.random(count)),
}
every_scheme = pytest.mark.parametrize("scheme", list(SCHEMES))

weight_lists = arrays(np.float64, st.integers(1, 30), elements=st.one_of(st.just(0.0), st.floats(1e-6, 1.0))).filter(
    lambda w: w.sum() > 0.0
)


@every_scheme
@either
@given(weights=weight_lists, seed=st.integers(0, 10_000), count=st.integers(1, 60))
@example(weights=np.array([0.0, 1.0, 0.0]), seed=0, count=5)
@example(weights=np.array([0.1] * 10 + [0.0]), seed=0, count=10)
def test_every_scheme_keeps_its_bounds(variant, scheme: str, weights: np.ndarray, seed: int, count: int) -> None:
    indices = SCHEMES[scheme](variant, weights, count, np.random.default_rng(seed))
    assert len(indices) == count
    assert np.all(np.diff(indices) >= 0)
    assert np.all(weights[indices] > 0.0)
    expected = count * weights / weights.sum()
    counts = np.bincount(indices, minlength=len(weights))
    # Where count * weight is whole but for rounding, either side of it may come out.
    low, high = np.floor(expected - 1e-9), np.ceil(expected + 1e-9)
    if scheme in ("systematic", "residual"):
        assert np.all(counts >= low)
    if scheme == "systematic":
        assert np.all(counts <= high)
    if scheme == "stratified":
        # A share touches at most two strata that it does not fill.
        assert np.all(np.abs(counts - expected) < 2.0 + 1e-9)


@either
@given(weights=weight_lists, offset=st.floats(0.0, 1.0, exclude_max=True), count=st.integers(1, 60))
@example(weights=np.array([0.1] * 10 + [0.0]), offset=np.nextafter(1.0, 0.0), count=10)
@example(weights=np.array([1.0, 0.0, 0.0]), offset=np.nextafter(1.0, 0.0), count=3)
def test_systematic_resampling_keeps_its_promise_at_any_offset(variant, weights, offset: float, count: int) -> None:
    indices = variant(resampling.systematic)(weights, offset, count)
    expected = count * weights / weights.sum()
    counts = np.bincount(indices, minlength=len(weights))
    assert np.all(weights[indices] > 0.0)
    assert np.all((counts >= np.floor(expected - 1e-9)) & (counts <= np.ceil(expected + 1e-9)))


@every_scheme
def test_every_scheme_is_unbiased(scheme: str) -> None:
    rng = np.random.default_rng(4)
    weights = np.array([0.02, 0.0, 0.31, 0.07, 0.25, 0.35])
    count, repeats = 7, 40_000

    def as_it_is(kernel):
        return kernel

    drawn = np.array(
        [np.bincount(SCHEMES[scheme](as_it_is, weights, count, rng), minlength=len(weights)) for _ in range(repeats)]
    )
    # Six standard errors; a count that never varies has none.
    allowed = 6.0 * drawn.std(axis=0) / np.sqrt(repeats) + 1e-12
    assert np.all(np.abs(drawn.mean(axis=0) - count * weights) <= allowed)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 777, 100_000])
def test_of_equal_weights_every_particle_goes_on_once(count: int) -> None:
    for weights in (np.ones(count), np.full(count, 1.0 / count), np.full(count, 1e-300)):
        for offset in (0.01, 0.5, 0.99):
            assert np.array_equal(resampling.systematic(weights, offset, count), np.arange(count))


def test_a_million_particles_are_all_met() -> None:
    # Sums in float32 would end several particles early or late.
    weights = np.random.default_rng(0).random(1_000_000).astype(np.float32).astype(np.float64)
    indices = resampling.systematic(weights, 0.999, len(weights))
    exact = np.cumsum(weights.astype(np.longdouble))
    targets = (np.arange(len(weights)) + np.longdouble(0.999)) / len(weights) * exact[-1]
    assert np.mean(indices != np.minimum(np.searchsorted(exact, targets, side="right"), len(weights) - 1)) < 1e-5


@either
@given(weights=weight_lists, offset=st.floats(0.01, 0.99), count=st.integers(1, 60))
def test_systematic_agrees_with_a_search_in_the_cumulative_sum(variant, weights, offset: float, count: int) -> None:
    targets = (np.arange(count) + offset) / count
    assume(np.abs((np.cumsum(weights) / weights.sum())[:, None] - targets).min() > 1e-12)
    assert np.array_equal(variant(resampling.systematic)(weights, offset, count), naive.pick(weights, targets))


@either
@given(weights=weight_lists, seed=st.integers(0, 10_000), count=st.integers(1, 60))
def test_the_others_agree_with_a_search_in_the_cumulative_sum(variant, weights, seed: int, count: int) -> None:
    uniforms = np.random.default_rng(seed).random(count)
    cumulative = (np.cumsum(weights) / weights.sum())[:, None]
    targets = (np.arange(count) + uniforms) / count
    assume(np.abs(cumulative - targets).min() > 1e-12)
    assume(np.abs(cumulative - uniforms).min() > 1e-12)
    assert np.array_equal(variant(resampling.stratified)(weights, uniforms), naive.pick(weights, targets))
    assert np.array_equal(variant(resampling.multinomial)(weights, uniforms), naive.pick(weights, np.sort(uniforms)))


def test_residual_agrees_with_numpy(variant) -> None:
    rng = np.random.default_rng(5)
    for count in (1, 5, 60, 500):
        weights, uniforms = rng.random(40) ** 3, rng.random(count)
        assert np.array_equal(variant(resampling.residual)(weights, uniforms), naive.residual(weights, uniforms))


def test_the_scale_of_the_weights_does_not_matter(variant) -> None:
    weights = np.random.default_rng(6).random(100)
    resample = variant(resampling.systematic)
    # A power of two changes no rounding.
    assert np.array_equal(resample(weights, 0.3, 100), resample(weights * 2.0**-900, 0.3, 100))

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import kernels as naive

from panoloc_mcl.geometry import angle_difference
from panoloc_mcl.kernels import particles

# The fixture only picks a function.
either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)


def some_poses(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform([-5.0, -5.0, -np.pi], [5.0, 5.0, np.pi], (count, 3))


@pytest.mark.parametrize(("sd_position", "sd_heading"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.3), (0.2, 2.0)])
def test_propagate_agrees_with_numpy(variant, sd_position: float, sd_heading: float) -> None:
    rng = np.random.default_rng(1)
    poses, normals = some_poses(rng, 500), rng.standard_normal((500, 3))
    for dx, dy, turn in rng.uniform(-3.0, 3.0, (5, 3)):
        moved = variant(particles.propagate)(poses, dx, dy, turn, sd_position, sd_heading, normals)
        expected = naive.propagate(poses, dx, dy, turn, sd_position, sd_heading, normals)
        assert np.abs(moved[:, :2] - expected[:, :2]).max() < 1e-12
        assert np.abs(angle_difference(moved[:, 2], expected[:, 2])).max() < 1e-12


@either
@given(heading=st.floats(-np.pi, np.pi), turn=st.floats(-10.0, 10.0))
@example(heading=-np.pi, turn=-1e-16)
@example(heading=-np.pi, turn=-4.4e-16)
@example(heading=np.nextafter(np.pi, 0.0), turn=5e-16)
@example(heading=np.nextafter(np.pi, 0.0), turn=0.0)
def test_propagated_headings_stay_in_the_range(variant, heading: float, turn: float) -> None:
    moved = variant(particles.propagate)(np.array([[0.0, 0.0, heading]]), 0.0, 0.0, turn, 0.0, 0.0, np.zeros((1, 3)))
    assert -np.pi <= moved[0, 2] < np.pi


def test_standing_still_moves_nothing_at_all(variant) -> None:
    rng = np.random.default_rng(2)
    poses = some_poses(rng, 200)
    still = poses
    for _ in range(20):
        still = variant(particles.propagate)(still, 0.0, 0.0, 0.0, 0.0, 0.0, rng.standard_normal((200, 3)))
    assert np.array_equal(still, poses)


def test_noise_is_as_wide_as_asked(variant) -> None:
    rng = np.random.default_rng(3)
    count = 4000
    start = np.tile([[0.0, 0.0, 1.0]], (count, 1))
    moved = variant(particles.propagate)(start, 0.0, 0.0, 0.5, 0.2, 0.1, rng.standard_normal((count, 3)))
    # Six standard errors of a standard deviation.
    share = 6.0 / np.sqrt(2.0 * count)
    assert moved.std(axis=0) == pytest.approx([0.2, 0.2, 0.1], rel=share)
    assert moved[:, 2].mean() == pytest.approx(1.5, abs=6.0 * 0.1 / np.sqrt(count))


def random_field(rng: np.random.Generator, headings: int, places: int) -> tuple:
    cells_x, cells_y, around = 7, 5, min(4, places)
    scores = rng.random((headings, places)).astype(np.float32)
    neighbours = rng.integers(0, places, (cells_x * cells_y, around)).astype(np.int32)
    weights = rng.random((cells_x * cells_y, around)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    weights[rng.random(len(weights)) < 0.2] = 0.0
    return scores, neighbours, weights, -3.0, -2.0, 0.8, cells_x, cells_y


@pytest.mark.parametrize(("headings", "places"), [(1, 1), (2, 3), (72, 6)])
def test_reading_the_field_agrees_with_numpy(variant, headings: int, places: int) -> None:
    rng = np.random.default_rng(headings)
    field = random_field(rng, headings, places)
    poses = some_poses(rng, 300)
    # Also headings several turns away.
    poses[:50, 2] += rng.integers(-3, 4, 50) * 2.0 * np.pi
    # The kernel adds up in float32.
    assert np.abs(variant(particles.read_field)(poses, *field) - naive.read_field(poses, *field)).max() < 1e-6


def test_the_field_is_continuous_over_the_seam_of_the_headings(variant) -> None:
    field = random_field(np.random.default_rng(4), 12, 4)
    seam = np.array([[-0.5, 0.5, np.pi - 1e-9], [-0.5, 0.5, -np.pi], [-0.5, 0.5, -1e-9], [-0.5, 0.5, 0.0]])
    left, right, below, zero = variant(particles.read_field)(seam, *field)
    assert left == pytest.approx(right, abs=1e-6)
    assert below == pytest.approx(zero, abs=1e-6)


def test_off_the_raster_there_are_no_votes(variant) -> None:
    field = random_field(np.random.default_rng(5), 8, 4)
    outside = np.array([[-3.01, 0.0, 0.0], [0.0, -2.01, 0.0], [2.61, 0.0, 0.0], [0.0, 2.01, 0.0], [1e9, -1e9, 0.0]])
    assert not variant(particles.read_field)(outside, *field).any()


weight_lists = arrays(np.float64, st.integers(1, 30), elements=st.one_of(st.just(0.0), st.floats(1e-6, 1.0))).filter(
    lambda w: w.sum() > 0.0
)


@either
@given(weights=weight_lists, offset=st.floats(0.0, 1.0, exclude_max=True), count=st.integers(1, 60))
@example(weights=np.array([0.0, 1.0, 0.0]), offset=0.0, count=5)
@example(weights=np.array([0.1] * 10 + [0.0]), offset=np.nextafter(1.0, 0.0), count=10)
@example(weights=np.array([1.0, 0.0, 0.0]), offset=np.nextafter(1.0, 0.0), count=3)
def test_systematic_resampling_keeps_its_promises(variant, weights: np.ndarray, offset: float, count: int) -> None:
    indices = variant(particles.systematic_resample)(weights, offset, count)
    assert len(indices) == count
    assert np.all(np.diff(indices) >= 0)
    assert np.all(weights[indices] > 0.0)
    expected = count * weights / weights.sum()
    counts = np.bincount(indices, minlength=len(weights))
    # Where count * weight is whole but for rounding, either side of it may come out.
    assert np.all(counts >= np.floor(expected - 1e-9))
    assert np.all(counts <= np.ceil(expected + 1e-9))


@either
@given(weights=weight_lists, offset=st.floats(0.01, 0.99), count=st.integers(1, 60))
def test_resampling_agrees_with_a_search_in_the_cumulative_sum(variant, weights, offset: float, count: int) -> None:
    cumulative = np.cumsum(weights) / weights.sum()
    targets = (np.arange(count) + offset) / count
    if np.abs(cumulative[:, None] - targets).min() > 1e-12:
        found = variant(particles.systematic_resample)(weights, offset, count)
        assert np.array_equal(found, naive.systematic_resample(weights, offset, count))


def test_the_scale_of_the_weights_does_not_matter(variant) -> None:
    weights = np.random.default_rng(6).random(100)
    resample = variant(particles.systematic_resample)
    # A power of two changes no rounding.
    assert np.array_equal(resample(weights, 0.3, 100), resample(weights * 2.0**-900, 0.3, 100))

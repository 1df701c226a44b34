import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from oracles import kernels as naive

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.kernels.filtering import particles, weights

# The fixture only picks a function.
either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
ORIGIN = (0.5, -0.25)


def some_particles(rng: np.random.Generator, count: int) -> CompactPoses:
    return CompactPoses.of(rng.uniform([-5.0, -5.0, -np.pi], [5.0, 5.0, np.pi], (count, 3)), ORIGIN)


def moved(variant, some: CompactPoses, parts, sds, key: int = 1, step: int = 2) -> CompactPoses:
    after = some.copy()
    variant(particles.predict)(*after.arrays, np.array(parts, float), np.array(sds, float), key, step, 0, len(some))
    return after


@pytest.mark.parametrize("sds", [(0.0, 0.0, 0.0, 0.0), (0.3, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.4), (0.0, 0.0, 0.1, 2.0)])
def test_predict_agrees_with_numpy(variant, sds: tuple[float, float, float, float]) -> None:
    rng = np.random.default_rng(1)
    some, key, step = some_particles(rng, 700), 2**62 + 12345, 7
    normals = naive.normals(key, step, 0, 0, 700)
    for parts in rng.uniform(-3.0, 3.0, (3, 4)):
        after = moved(variant, some, parts, sds, key, step).poses.T
        expected = naive.propagate(some.poses.T, parts[[0, 3]], parts[1:3], (sds[0], sds[3]), sds[1:3], normals)
        assert np.abs(after[:2] - expected[:2]).max() < 1e-5
        assert np.abs(angle_difference(after[2], expected[2])).max() < 1e-5


@either
@given(heading=st.floats(-np.pi, np.pi), turn=st.floats(-10.0, 10.0))
@example(heading=-np.pi, turn=-1e-16)
@example(heading=np.nextafter(np.pi, 0.0), turn=5e-16)
@example(heading=np.nextafter(np.pi, 0.0), turn=0.0)
def test_headings_go_round_the_circle(variant, heading: float, turn: float) -> None:
    after = moved(variant, CompactPoses.of(np.array([[0.0, 0.0, heading]])), (turn, 0.0, 0.0, 0.0), np.zeros(4)).poses[0]
    assert -np.pi <= after[2] < np.pi
    assert abs(float(angle_difference(after[2], heading + turn))) < 1e-8


def test_standing_still_moves_nothing_at_all(variant) -> None:
    before = some_particles(np.random.default_rng(2), 200)
    still = before
    for step in range(20):
        still = moved(variant, still, np.zeros(4), np.zeros(4), step=step)
    assert all(np.array_equal(one, other) for one, other in zip(still.arrays, before.arrays, strict=True))


def test_noise_is_as_wide_as_asked(variant) -> None:
    count = 4000
    start = CompactPoses.of(np.tile([0.0, 0.0, 1.0], (count, 1)))
    after = moved(variant, start, (-1.0, 2.0, 0.0, 0.5), (0.0, 0.2, 0.3, 0.1), 5, 6).poses
    # Six standard errors of a standard deviation. The drive is along x: the first turn was back by as much as the heading.
    assert after.std(axis=0) == pytest.approx([0.2, 0.3, 0.1], rel=6.0 / np.sqrt(2.0 * count))
    assert after.mean(axis=0) == pytest.approx([2.0, 0.0, 0.5], abs=6.0 * 0.3 / np.sqrt(count))


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 7, 64, 333, 600])
def test_a_particle_moves_the_same_in_whatever_company(variant, cut: int) -> None:
    every, parts, sds = some_particles(np.random.default_rng(8), 1200), np.array([0.3, 0.1, 0.02, -0.2]), np.full(4, 0.1)
    move, whole, pieces = variant(particles.predict), every.copy(), every.copy()
    move(*whole.arrays, parts, sds, 2**40 + 3, 9, 0, 1200)
    for first, last in ((cut, 1200), (0, cut)):
        move(*pieces.arrays, parts, sds, 2**40 + 3, 9, first, last)
    assert all(np.array_equal(one, other) for one, other in zip(whole.arrays, pieces.arrays, strict=True))


def random_field(rng: np.random.Generator, headings: int, places: int) -> tuple:
    cells_x, cells_y, around = 7, 5, min(4, places)
    scores = rng.random((headings, places)).astype(np.float32)
    neighbours = rng.integers(0, places, (cells_x * cells_y, around)).astype(np.int32)
    shares = rng.random((cells_x * cells_y, around)).astype(np.float32)
    shares /= shares.sum(axis=1, keepdims=True)
    shares[rng.random(len(shares)) < 0.2] = 0.0
    return scores, np.zeros(0, dtype=np.int32), neighbours, shares, -3.0, -2.0, 0.8, cells_x, cells_y


@pytest.mark.parametrize(("headings", "places"), [(1, 1), (2, 3), (72, 6)])
def test_reading_the_field_agrees_with_numpy(variant, headings: int, places: int) -> None:
    rng = np.random.default_rng(headings)
    scores, *raster = random_field(rng, headings, places)
    some = some_particles(rng, 700)
    # From the origin, exactly as single precision has them.
    poses = (some.poses - [*some.origin, 0.0]).T
    found = variant(particles.read_field)(*some.arrays, scores, *raster)
    # The kernel adds up in float32, and reads between headings to 24 bits.
    assert np.abs(found - naive.read_field(poses, scores, *raster[1:])).max() < 2e-6
    fitted = np.empty_like(found)
    variant(particles.likelihoods_there)(*some.arrays, scores, *raster, 0.8, 0.15, 0.5, 0.01, fitted)
    assert np.array_equal(fitted, variant(weights.likelihoods)(found, 0.8, 0.15, 0.5, 0.01))


@pytest.mark.parametrize("places", [3, 40])
def test_places_are_read_in_their_columns(variant, places: int) -> None:
    rng = np.random.default_rng(places)
    some, columns = some_particles(rng, 700), rng.integers(0, 5, places).astype(np.int32)
    _, _, *raster = random_field(rng, 24, places)
    scores = rng.random((24, 5)).astype(np.float32)
    poses = (some.poses - [*some.origin, 0.0]).T
    found = variant(particles.read_field)(*some.arrays, scores, columns, *raster)
    assert np.abs(found - naive.read_field(poses, scores[:, columns], *raster)).max() < 2e-6


def test_the_field_is_continuous_over_the_seam_of_the_headings(variant) -> None:
    field = random_field(np.random.default_rng(4), 12, 4)
    seam = np.array([[-0.5, 0.5, np.pi - 1e-9], [-0.5, 0.5, -np.pi], [-0.5, 0.5, -1e-9], [-0.5, 0.5, 0.0]])
    left, right, below, zero = variant(particles.read_field)(*CompactPoses.of(seam, (0.0, 0.0)).arrays, *field)
    assert left == pytest.approx(right, abs=1e-6)
    assert below == pytest.approx(zero, abs=1e-6)


def test_off_the_raster_there_are_no_votes(variant) -> None:
    field = random_field(np.random.default_rng(5), 8, 4)
    outside = np.array([[-3.01, 0.0, 0.0], [0.0, -2.01, 0.0], [2.61, 0.0, 0.0], [0.0, 2.01, 0.0], [1e9, -1e9, 0.0]])
    assert not variant(particles.read_field)(*CompactPoses.of(outside, (0.0, 0.0)).arrays, *field).any()


def test_what_is_taken_agrees_with_numpy(variant) -> None:
    rng = np.random.default_rng(7)
    some, indices = some_particles(rng, 50), np.sort(rng.integers(0, 50, 80))
    room = CompactPoses.empty(some.origin, 80)
    variant(particles.take)(*some.arrays, indices, *room.arrays)
    assert all(np.array_equal(one, other[indices]) for one, other in zip(room.arrays, some.arrays, strict=True))

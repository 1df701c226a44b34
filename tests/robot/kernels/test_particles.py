import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from oracles import kernels as naive

from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.kernels import particles

# The fixture only picks a function.
either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)


def some_particles(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform([-5.0, -5.0, -np.pi], [5.0, 5.0, np.pi], (count, 3)).T.copy()


@pytest.mark.parametrize("sds", [(0.0, 0.0, 0.0, 0.0), (0.3, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.4), (0.0, 0.0, 0.1, 2.0)])
def test_propagate_agrees_with_numpy(variant, sds: tuple[float, float, float, float]) -> None:
    rng = np.random.default_rng(1)
    particles_, key, step = some_particles(rng, 300), 2**62 + 12345, 7
    normals = naive.normals(key, step, 0, 0, 300)
    for first_turn, along, across, last_turn in rng.uniform(-3.0, 3.0, (3, 4)):
        motion = (first_turn, along, across, last_turn)
        moved = variant(particles.propagate)(particles_, *motion, *sds, key, step, 0, 300)
        expected = naive.propagate(particles_, (first_turn, last_turn), (along, across), (sds[0], sds[3]), sds[1:3], normals)
        assert np.abs(moved[:2] - expected[:2]).max() < 1e-12
        assert np.abs(angle_difference(moved[2], expected[2])).max() < 1e-12


@either
@given(heading=st.floats(-np.pi, np.pi), turn=st.floats(-10.0, 10.0))
@example(heading=-np.pi, turn=-1e-16)
@example(heading=-np.pi, turn=-4.4e-16)
@example(heading=np.nextafter(np.pi, 0.0), turn=5e-16)
@example(heading=np.nextafter(np.pi, 0.0), turn=0.0)
def test_propagated_headings_stay_in_the_range(variant, heading: float, turn: float) -> None:
    one = np.array([[0.0], [0.0], [heading]])
    moved = variant(particles.propagate)(one, turn, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1, 2, 0, 1)
    assert -np.pi <= moved[2, 0] < np.pi


def test_standing_still_moves_nothing_at_all(variant) -> None:
    before = some_particles(np.random.default_rng(2), 200)
    still = before
    for step in range(20):
        still = variant(particles.propagate)(still, *[0.0] * 8, 3, step, 0, 200)
    assert np.array_equal(still, before)


def test_noise_is_as_wide_as_asked(variant) -> None:
    count = 4000
    start = np.tile([[0.0], [0.0], [1.0]], (1, count))
    moved = variant(particles.propagate)(start, -1.0, 2.0, 0.0, 0.5, 0.0, 0.2, 0.3, 0.1, 5, 6, 0, count)
    # Six standard errors of a standard deviation. The drive is along x: the first turn was back by as much as the heading.
    share = 6.0 / np.sqrt(2.0 * count)
    assert moved.std(axis=1) == pytest.approx([0.2, 0.3, 0.1], rel=share)
    assert moved.mean(axis=1) == pytest.approx([2.0, 0.0, 0.5], abs=6.0 * 0.3 / np.sqrt(count))


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 7, 64, 333])
def test_a_particle_moves_the_same_in_whatever_company(variant, cut: int) -> None:
    every, rest = some_particles(np.random.default_rng(8), 400), (0.3, 0.1, 0.02, -0.2, 0.1, 0.1, 0.1, 0.1, 2**40 + 3, 9)
    move = variant(particles.propagate)
    whole = move(every, *rest, 0, 400)
    assert np.array_equal(whole[:, :cut], move(every, *rest, 0, cut))
    assert np.array_equal(whole[:, cut:], move(every, *rest, cut, 400))


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
    poses = some_particles(rng, 300)
    # Also headings several turns away.
    poses[2, :50] += rng.integers(-3, 4, 50) * 2.0 * np.pi
    # The kernel adds up in float32.
    assert np.abs(variant(particles.read_field)(poses, *field) - naive.read_field(poses, *field)).max() < 1e-6


def test_the_field_is_continuous_over_the_seam_of_the_headings(variant) -> None:
    field = random_field(np.random.default_rng(4), 12, 4)
    seam = np.array([[-0.5, 0.5, np.pi - 1e-9], [-0.5, 0.5, -np.pi], [-0.5, 0.5, -1e-9], [-0.5, 0.5, 0.0]])
    left, right, below, zero = variant(particles.read_field)(seam.T.copy(), *field)
    assert left == pytest.approx(right, abs=1e-6)
    assert below == pytest.approx(zero, abs=1e-6)


def test_off_the_raster_there_are_no_votes(variant) -> None:
    field = random_field(np.random.default_rng(5), 8, 4)
    outside = np.array([[-3.01, 0.0, 0.0], [0.0, -2.01, 0.0], [2.61, 0.0, 0.0], [0.0, 2.01, 0.0], [1e9, -1e9, 0.0]])
    assert not variant(particles.read_field)(outside.T.copy(), *field).any()


@pytest.mark.parametrize("turns", [1, 24, 36])
def test_cells_and_their_moments_agree_with_numpy(variant, turns: int) -> None:
    rng = np.random.default_rng(7)
    some, weights = some_particles(rng, 400), rng.random(400)
    some[2, :50] += rng.integers(-2, 3, 50) * 2.0 * np.pi
    keys, marked = variant(particles.cells_of)(some, -5.4, -5.4, 0.6, 20, turns, 20 * 20 * turns)
    assert np.array_equal(np.flatnonzero(marked), np.unique(keys))
    assert np.array_equal(variant(particles.cells_of)(some, -5.4, -5.4, 0.6, 20, turns, 0)[0], keys)
    assert np.array_equal(keys, naive.cells_of(some, -5.4, -5.4, 0.6, 20, turns))
    occupied, slots = np.unique(keys, return_inverse=True)
    centres = (np.stack(np.divmod(occupied // turns, 20), axis=-1) + 0.5) * 0.6
    table = np.zeros(keys.max() + 1, dtype=np.int64)
    table[occupied] = np.arange(len(occupied))
    moments = variant(particles.cell_moments)(some, weights, keys, table, centres, -5.4, -5.4, turns)
    assert moments == pytest.approx(naive.cell_moments(some, weights, slots, centres, -5.4, -5.4, turns), abs=1e-12)
    assert moments[:, 0].sum() == pytest.approx(weights.sum())


@pytest.mark.parametrize(("cells", "labels"), [(1, 1), (9, 2), (40, 5)])
def test_merged_cells_agree_with_numpy(variant, cells: int, labels: int) -> None:
    rng = np.random.default_rng(cells)
    which = np.concatenate([np.arange(labels), rng.integers(0, labels, cells - labels)])
    # Around the seam, so that headings of one label lie on both sides of it.
    origins = np.column_stack([rng.uniform(-5.0, 5.0, (cells, 2)), np.pi + rng.uniform(-1.0, 1.0, cells)])
    origins[:, 2] = np.mod(origins[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    weights, offsets = rng.random((cells, 6)), rng.uniform(-0.2, 0.2, (cells, 6, 3))
    x, y, t = np.moveaxis(offsets, -1, 0)
    powers = np.stack([np.ones_like(x), x, y, t, x * x, x * y, y * y, x * t, y * t, t * t], axis=-1)
    moments = np.sum(weights[..., None] * powers, axis=1)
    merged = variant(particles.merge_cells)(which, labels, origins, moments)
    for ours, expected in zip(merged, naive.merge_cells(which, labels, origins, moments), strict=True):
        assert ours == pytest.approx(expected, abs=1e-12)
    assert (np.linalg.eigvalsh(merged[2]) > -1e-12).all()


@pytest.mark.parametrize(("cells", "turns"), [(1, 24), (30, 24), (120, 24), (300, 3)])
def test_links_agree_with_flooding(variant, cells: int, turns: int) -> None:
    rng = np.random.default_rng(cells)
    rows, columns = 12, 10
    # None at the rim.
    inner = rng.integers(1, columns - 1, cells) * rows + rng.integers(1, rows - 1, cells)
    occupied = np.unique(inner * turns + rng.integers(0, turns, cells))
    heavy = rng.random(len(occupied)) < 0.7
    heavy[0] = True
    labels = variant(particles.link_cells)(occupied, heavy, rows, turns)
    flooded, touch = naive.link_cells(occupied, heavy, rows, turns)
    for one in range(len(occupied)):
        if heavy[one]:
            assert np.array_equal(labels[heavy] == labels[one], flooded[heavy] == flooded[one])
        elif (touch[one] & heavy).any():
            assert labels[one] in labels[touch[one] & heavy]
        else:
            assert np.sum(labels == labels[one]) == 1
    firsts = [int(np.flatnonzero(labels == label)[0]) for label in range(labels.max() + 1)]
    assert firsts == sorted(firsts)

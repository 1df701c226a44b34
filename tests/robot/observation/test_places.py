import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import grid
from oracles.votes import shepard

from panoloc_mcl.robot.observation import Places

LAYOUTS = {
    "single": np.array([[2.0, -1.0]]),
    "two": np.array([[0.0, 0.0], [1.5, 0.5]]),
    "three": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    "four": grid(2, 2),
    "grid": grid(4, 3),
    "collinear": np.array([[float(x), 0.0] for x in range(6)]),
    "duplicates": np.repeat(grid(3, 2, 0.5), 2, axis=0),
    "many_duplicates": np.repeat(grid(2, 1, 0.5), 7, axis=0),
    "all_at_one_place": np.zeros((6, 2)),
    "scattered": np.random.default_rng(0).uniform(-3.0, 3.0, (20, 2)),
}


@pytest.fixture(params=LAYOUTS)
def places(request) -> Places:
    return Places(LAYOUTS[request.param])


def cell_centres(places: Places) -> np.ndarray:
    raster = places.raster
    rows, columns = np.divmod(np.arange(raster.shape[0] * raster.shape[1]), raster.shape[1])
    return np.asarray(raster.origin) + (np.column_stack([columns, rows]) + 0.5) * raster.cell


def test_weights_sum_to_one_on_the_map_and_to_zero_off_it(places: Places) -> None:
    sums = places.raster.weights.sum(axis=1)
    on = places.contains(cell_centres(places))
    assert on.any()
    assert not on.all()
    assert sums[on] == pytest.approx(1.0, abs=1e-6)
    assert not places.raster.weights[~on].any()
    assert places.raster.weights.min() >= 0.0
    assert places.raster.neighbours.min() >= 0
    assert places.raster.neighbours.max() < len(places)


@pytest.mark.parametrize("name", ["single", "two", "three", "four", "scattered"])
def test_weights_agree_with_those_of_franke_and_little(name: str) -> None:
    places = Places(LAYOUTS[name])
    centres = cell_centres(places)
    for cell in np.random.default_rng(1).choice(len(centres), 200):
        weights = np.zeros(len(places))
        reach = places.reach if places.contains(centres[cell][None])[0] else 0.0
        np.add.at(weights, places.raster.neighbours[cell], places.raster.weights[cell])
        assert weights == pytest.approx(shepard(places.positions, centres[cell], 4, 1.5, reach), abs=1e-5)


def interpolated(places: Places, values: np.ndarray) -> np.ndarray:
    raster = places.raster
    read = (raster.weights * values[raster.neighbours]).sum(axis=1)
    return read.reshape(raster.shape)


@pytest.mark.parametrize("name", ["single", "two", "three", "four", "grid", "collinear", "scattered"])
def test_what_is_read_is_continuous(name: str) -> None:
    places = Places(LAYOUTS[name])
    values = np.random.default_rng(2).random(len(places))
    read = interpolated(places, values)
    on = places.contains(cell_centres(places)).reshape(read.shape)
    spread = np.ptp(values)
    for axis in (0, 1):
        steps = np.abs(np.diff(read, axis=axis))[np.logical_and(*_pairs(on, axis))]
        # A cell is a twentieth of a spacing: far less than the way from one place's value to the next one's.
        assert steps.max(initial=0.0) <= 0.35 * spread + 1e-6
        assert np.median(steps) <= 0.05 * spread + 1e-6


def _pairs(mask: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    return np.take(mask, range(mask.shape[axis] - 1), axis), np.take(mask, range(1, mask.shape[axis]), axis)


def test_at_a_place_its_own_value_is_read(places: Places) -> None:
    positions, index = np.unique(places.positions, axis=0, return_inverse=True)
    values = np.arange(1.0, len(positions) + 1.0)
    read = interpolated(places, values[index.ravel()])
    raster = places.raster
    columns, rows = np.floor((positions - raster.origin) / raster.cell + 1e-9).astype(int).T
    # The cell's centre is half a cell away at most.
    at_places = read[rows, columns]
    assert np.abs(at_places - values).max() <= 0.12 * max(np.ptp(values), 0.01)


@pytest.mark.parametrize(
    ("name", "spacing"),
    [("single", 1.0), ("two", np.hypot(1.5, 0.5)), ("grid", 1.0), ("duplicates", 0.5), ("many_duplicates", 0.5),
     ("all_at_one_place", 1.0)],
)  # fmt: skip
def test_the_spacing_is_that_of_distinct_places(name: str, spacing: float) -> None:
    assert Places(LAYOUTS[name]).spacing == pytest.approx(spacing)


def test_sampled_positions_lie_on_the_map_and_all_over_it(places: Places) -> None:
    sample = places.sample_uniform(2000, np.random.default_rng(3))
    # A cell at the rim is on the map when its centre is.
    distance = np.hypot(*(sample[:, None] - places.positions[None]).transpose(2, 0, 1)).min(axis=1)
    assert distance.max() <= places.reach + places.raster.cell
    assert len(np.unique(places.nearest(sample))) == len(np.unique(places.positions, axis=0))


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 12), st.integers(0, 10_000))
def test_nearest_and_contains_are_what_distances_say(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = Places(rng.uniform(-4.0, 4.0, (count, 2)))
    at = rng.uniform(-6.0, 6.0, (50, 2))
    distances = np.hypot(*(at[:, None] - places.positions[None]).transpose(2, 0, 1))
    assert np.array_equal(places.nearest(at), distances.argmin(axis=1))
    # Of the four nearest, which is as many as votes are read from.
    near = np.argsort(distances, axis=1)[:, :4]
    inside = np.take_along_axis(distances, near, axis=1) <= places.reaches[near]
    assert np.array_equal(places.contains(at), inside.any(axis=1))


def test_a_wide_map_of_close_places_keeps_its_raster_within_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    from panoloc_mcl.robot.observation import places as module

    monkeypatch.setattr(module, "_MAX_CELLS", 10_000)
    wide = Places(np.array([[0.0, 0.0], [1.0, 0.0], [80.0, 40.0], [81.0, 40.0]]))
    assert len(wide.raster.weights) <= 12_000
    assert wide.sample_uniform(10, np.random.default_rng(0)).shape == (10, 2)


def test_a_line_of_close_references_reaches_to_its_sides() -> None:
    line = Places(np.column_stack([np.arange(0.0, 3.0, 0.02), np.zeros(150)]))
    assert line.spacing == pytest.approx(0.02)
    assert line.contains(np.array([[1.0, 0.45], [1.0, 0.55]])).tolist() == [True, False]
    virtual = Places(line.positions, references=line.positions, least_reach=0.0)
    assert not virtual.contains(np.array([[1.0, 0.45]])).any()

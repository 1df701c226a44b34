import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from oracles import warping as naive
from oracles.rooms import BareRoom
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.kernels import elementary, warping
from panoloc_mcl.robot.synthesis.views import FloorRays

# The fixture only picks a function.
either = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20, deadline=None)
GEOMETRY = PanoramaGeometry(90, 36, -50.0, 25.0)
RAYS = FloorRays.of(GEOMETRY, 0.6)
ROOM = BareRoom()
finite = st.floats(-1e6, 1e6, width=32)


@either
@given(y=finite, x=finite)
@example(y=0.0, x=0.0)
@example(y=0.0, x=-1.0)
@example(y=-1.0, x=0.0)
@example(y=1.0, x=1.0)
@example(y=1e-36, x=-1e-36)
@example(y=1e-45, x=0.0)
def test_arctan2_agrees_with_the_library(variant, y: float, x: float) -> None:
    difference = float(variant(elementary.arctan2)(np.float32(y), np.float32(x))) - np.arctan2(y, x)
    if y == 0.0 and x < 0.0:  # where -0 and 0 are half turns to both sides
        difference = abs(difference) % (2.0 * np.pi)
    if max(abs(x), abs(y)) > 1e-30:
        assert abs(difference) < 5e-7
    else:
        assert np.isfinite(difference)


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (0.3, -0.7), (-1.2, 0.4)])
@pytest.mark.parametrize("source_columns", [90, 360])
def test_warp_table_agrees_with_numpy(variant, dx: float, dy: float, source_columns: int) -> None:
    profile = naive.some_profile(np.random.default_rng(1))
    arguments = (profile, RAYS.tangents, RAYS.floor, dx, dy, RAYS.top, RAYS.row_step, source_columns, 4)
    map_x, map_y = variant(warping.warp_table)(*arguments)
    expected_x, expected_y = naive.warp_table(*arguments)
    assert map_x.dtype == map_y.dtype == np.float32
    # At the seam 0 and the last column are the same.
    across = (map_x - expected_x + source_columns / 2) % source_columns - source_columns / 2
    assert np.abs(across).max() < 1e-4
    assert np.abs(map_y - expected_y).max() < 1e-4
    # What is read stays within the margins.
    assert map_x.min() >= 4
    assert map_x.max() <= source_columns + 4


@either
@given(
    heading=st.floats(-np.pi, np.pi),
    pitch=st.floats(-0.2, 0.2),
    roll=st.floats(-0.2, 0.2),
    stride=st.sampled_from([1, 2]),
)
def test_turned_table_agrees_with_rotated_rays(variant, heading: float, pitch: float, roll: float, stride: int) -> None:
    turn = Rotation.from_rotvec([roll, pitch, 0.0])
    tangents, azimuths = np.ascontiguousarray(RAYS.tangents[::stride]), naive.azimuths(90)[::stride].copy()
    map_x, map_y = variant(warping.turned_table)(tangents, azimuths, heading, turn.as_matrix(), RAYS.top, RAYS.row_step, 90, 4)
    assert map_x.dtype == map_y.dtype == np.float32
    azimuth, elevation = np.meshgrid(azimuths - heading, np.arctan(tangents))
    rays = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)
    seen = turn.inv().apply(rays.reshape(-1, 3)).reshape(rays.shape)
    expected_x = GEOMETRY.column_of_azimuth(np.arctan2(seen[..., 1], seen[..., 0])) + 4
    expected_y = GEOMETRY.row_of_elevation(np.arcsin(seen[..., 2]))
    assert np.abs((map_x - expected_x + 45) % 90 - 45).max() < 1e-4
    assert np.abs(map_y - expected_y).max() < 1e-4
    assert 4 <= map_x.min() <= map_x.max() <= 94


@either
@given(seed=st.integers(0, 10_000))
def test_standing_still_is_the_identity(variant, seed: int) -> None:
    profile = naive.some_profile(np.random.default_rng(seed))
    map_x, map_y = variant(warping.warp_table)(profile, RAYS.tangents, RAYS.floor, 0.0, 0.0, RAYS.top, RAYS.row_step, 90, 4)
    columns, rows = np.meshgrid(np.arange(90), np.arange(36))
    assert np.abs(map_y - rows).max() < 1e-4
    assert np.abs((map_x - 4 - columns + 45) % 90 - 45).max() < 1e-4
    assert variant(warping.move_profile)(profile, 0.0, 0.0) == pytest.approx(profile, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("dx", "dy"), [(0.31, -0.22), (-0.6, 0.55), (5.0, 0.1)])
def test_move_profile_agrees_with_a_search(variant, seed: int, dx: float, dy: float) -> None:
    profile = naive.some_profile(np.random.default_rng(seed))
    moved = variant(warping.move_profile)(profile, dx, dy)
    assert moved == pytest.approx(naive.move_profile(profile, dx, dy), rel=1e-9)


@either
@given(seed=st.integers(0, 10_000), dx=st.floats(-30.0, 30.0), dy=st.floats(-30.0, 30.0))
@example(seed=0, dx=1000.0, dy=300.0)
def test_moved_profiles_are_finite_wherever_they_are_seen_from(variant, seed: int, dx: float, dy: float) -> None:
    moved = variant(warping.move_profile)(naive.some_profile(np.random.default_rng(seed)), dx, dy)
    assert np.isfinite(moved).all()
    assert np.all(moved >= 0.0)


@either
@given(x=st.floats(-0.5, 2.5), y=st.floats(-0.5, 2.0), dx=st.floats(-0.6, 0.6), dy=st.floats(-0.6, 0.6))
def test_walls_of_a_convex_room_stand_where_they_are(variant, x: float, y: float, dx: float, dy: float) -> None:
    moved = variant(warping.move_profile)(ROOM.profile((x, y), 360), dx, dy)
    expected = ROOM.profile((x + dx, y + dy), 360)
    # Corners are cut by the columns.
    assert np.median(np.abs(moved / expected - 1.0)) < 1e-3
    assert np.abs(moved / expected - 1.0).max() < 0.05


@either
@given(x=st.floats(0.0, 2.0), y=st.floats(0.0, 1.5), dx=st.floats(-0.5, 0.5), dy=st.floats(-0.5, 0.5))
def test_there_and_back_again(variant, x: float, y: float, dx: float, dy: float) -> None:
    profile = ROOM.profile((x, y), 180)
    move = variant(warping.move_profile)
    back = move(move(profile, dx, dy), -dx, -dy)
    assert np.median(np.abs(back / profile - 1.0)) < 2e-3
    assert np.abs(back / profile - 1.0).max() < 0.08


def test_a_hole_shows_the_farther_of_its_rims(variant) -> None:
    # A pillar at 1 m ahead before a wall at 4 m: from the side, what it hid is unknown.
    profile = np.full(90, 4.0)
    profile[43:48] = 1.0
    moved = variant(warping.move_profile)(profile, -0.5, 0.6)
    near = moved < 2.0
    assert 2 <= near.sum() <= 6
    assert moved[~near].min() > 3.0


def test_column_agreement_agrees_with_numpy(variant) -> None:
    rng = np.random.default_rng(3)
    shape = (36, 90)
    first, second = ((rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64) for _ in range(2))
    usable = [rng.random(shape) < 0.8 for _ in range(2)]
    usable[0][:, 7] = False
    arguments = (first, usable[0], second, usable[1])
    for found, expected in zip(variant(warping.column_agreement)(*arguments), naive.column_agreement(*arguments), strict=True):
        assert found.dtype == np.float64
        assert found == pytest.approx(expected, abs=1e-5)
        assert found[7] == 0.0

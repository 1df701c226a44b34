from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import LIGHTS, RoomRenderer, build_room, furnished_room, noisy_odometry, wander
from oracles.furnished_room.build import GRID

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import between
from panoloc_mcl.tools.datasets import Trajectory, check_dataset, read_dataset, read_image

ROOM = furnished_room(7)
GEOMETRY = PanoramaGeometry(120, 48, -50.0, 25.0)


@pytest.fixture(scope="module")
def renderers() -> dict[str, RoomRenderer]:
    return {name: RoomRenderer(ROOM, light, GEOMETRY) for name, light in LIGHTS.items()}


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def test_a_turn_of_the_robot_rolls_the_panorama(renderers: dict[str, RoomRenderer]) -> None:
    straight = renderers["noon"].radiance((1.0, 1.0, 0.0))
    left = renderers["noon"].radiance((1.0, 1.0, np.radians(30.0)))
    assert (
        np.abs(np.roll(straight, 10, axis=1) - left).max() < 1e-4 or correlation(np.roll(straight, 10, axis=1), left) > 0.9999
    )


def test_walls_lie_where_they_should(renderers: dict[str, RoomRenderer]) -> None:
    renderer = renderers["noon"]
    directions = np.array([[1.0, -1.0, 1e-9, 1e-9], [1e-9, 1e-9, 1.0, -1.0]])
    distance, surface = renderer._hit_shell(np.array([1.0, 1.0]), directions)
    level = int(GEOMETRY.row_of_elevation(0.0) * 2)
    assert np.allclose(distance[level], [4.0, 2.0, 3.0, 2.0])
    assert surface[level].tolist() == [1, 0, 3, 2]
    assert np.all(surface[-1] == 4)


def test_pictures_are_of_a_room_and_not_noise(renderers: dict[str, RoomRenderer]) -> None:
    here = renderers["noon"].render((1.0, 1.0, 0.0), np.random.default_rng(0)).astype(float)
    again = renderers["noon"].render((1.0, 1.0, 0.0), np.random.default_rng(1)).astype(float)
    near = renderers["noon"].render((1.05, 1.0, 0.0), np.random.default_rng(2)).astype(float)
    far = renderers["noon"].render((4.0, 3.0, 0.0), np.random.default_rng(3)).astype(float)
    assert correlation(here, again) > 0.995
    assert 0.85 < correlation(here, near) < correlation(here, again)
    assert correlation(here, far) < 0.6
    assert here.std() > 20.0
    assert np.mean((here == 0) | (here == 255)) < 0.1
    assert correlation(here[:, :-1], here[:, 1:]) > 0.8  # neighbours resemble each other


def test_the_light_changes_more_than_the_brightness(renderers: dict[str, RoomRenderer]) -> None:
    noon, evening = (renderers[name].radiance((1.0, 1.0, 0.0)) for name in ("noon", "evening"))
    assert evening.mean() < 0.8 * noon.mean()
    assert correlation(noon, evening) < 0.8


def test_references_and_drives_keep_clear_of_furniture() -> None:
    assert ROOM.clearance(np.array(GRID)).min() > 0.4
    path = wander(ROOM, 60.0, np.random.default_rng(5))
    assert ROOM.clearance(path.poses[:, :2]).min() >= 0.4
    speed = np.hypot(*np.diff(path.poses[:, :2], axis=0).T) / np.diff(path.times)
    assert speed.max() <= 0.5
    assert np.hypot(*np.diff(path.poses[:, :2], axis=0).T).sum() > 5.0


def test_odometry_starts_at_its_own_origin_and_drifts() -> None:
    times = np.arange(0.0, 100.0, 1.0 / 6.0)
    straight = Trajectory(times, np.column_stack([0.4 * times + 3.0, np.full_like(times, 2.0), np.zeros_like(times)]))
    exact = noisy_odometry(straight, times, np.random.default_rng(0), 0.0, 0.0, 0.0)
    assert np.allclose(exact.poses, straight.poses - [3.0, 2.0, 0.0], atol=1e-9)
    drifting = noisy_odometry(straight, times, np.random.default_rng(0))
    assert np.array_equal(drifting.poses[0], np.zeros(3))
    assert abs(drifting.poses[-1, 2]) == pytest.approx(np.radians(1.0) * 0.4 * times[-1])
    steps = np.hypot(*between(drifting.poses[:-1], drifting.poses[1:])[:, :2].T)
    assert steps.std() / steps.mean() == pytest.approx(0.1, rel=0.15)


def test_the_same_seed_gives_the_same_bytes(room: Path, tmp_path: Path) -> None:
    small = PanoramaGeometry(72, 30, -50.0, 25.0)
    calls: list[tuple[int, int]] = []
    again = build_room(
        tmp_path / "again", frames=3, geometry=small, grid=((0.0, 0.0), (1.0, 0.0), (3.0, 2.0)), lights=("noon",),
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    files = sorted(path.relative_to(room) for path in room.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(again) for path in again.rglob("*") if path.is_file())
    assert all((room / file).read_bytes() == (again / file).read_bytes() for file in files)
    assert calls == [(done, 6) for done in range(1, 7)]
    other = build_room(tmp_path / "other", seed=8, frames=1, geometry=small, grid=((0.0, 0.0),), lights=("noon",))
    assert (other / "references/ref_000.png").read_bytes() != (room / "references/ref_000.png").read_bytes()


def test_stamps_of_odometry_are_its_own(room: Path) -> None:
    assert check_dataset(room) == []
    sequence = read_dataset(room).sequences["noon_00"]
    assert sequence.odometry is not None
    assert not np.isin(sequence.odometry.times, sequence.times).any()
    assert sequence.odometry.times[0] < sequence.times[0]
    assert sequence.odometry.times[-1] > sequence.times[-1]
    assert 1.0 / np.diff(sequence.odometry.times).mean() == pytest.approx(6.0, rel=0.01)
    assert read_image(sequence.files[0]).dtype == np.uint8


def test_an_unknown_light(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="unknown 'night'; known: noon"):
        build_room(tmp_path / "x", lights=("night",))

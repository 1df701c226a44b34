"""The simulated building: each room is like the others and none the same, and images are what a camera there sees."""

import numpy as np
import pytest

from panoloc_mcl.laboratory.benchmarks.campus import building
from panoloc_mcl.laboratory.benchmarks.campus.rooms import HEIGHT_M, SIZE_M, rooms

SHAPE = building.geometry(120)
SEEN = np.array([4.0, 3.0, 0.0])


def image_in(number: int, pose: np.ndarray = SEEN) -> np.ndarray:
    room = rooms(9)[number]
    return room.panorama(SHAPE, pose + np.array([*room.corner, 0.0])).astype(np.float64)


def test_a_turn_by_whole_columns_shifts_the_image() -> None:
    turned = image_in(0, SEEN + np.array([0.0, 0.0, 2.0 * np.pi * 7 / 120]))
    # Azimuth falls with the column.
    assert np.abs(turned - np.roll(image_in(0), 7, axis=1)).max() <= 1.0


def test_rooms_have_the_same_floor_and_walls_of_their_own() -> None:
    near_floor = SHAPE.elevation_of_row(np.arange(SHAPE.height)) < -np.arctan2(HEIGHT_M, 1.5)
    one, other = image_in(0), image_in(5)
    assert np.abs(one - other)[near_floor].max() <= 1.0
    assert np.abs(one - other)[~near_floor].mean() > 5.0
    assert np.array_equal(one, image_in(0))


def test_a_wall_meets_the_floor_where_geometry_says() -> None:
    # Looking along x, the skirting, 10 cm high and dark, begins at the foot of the wall.
    shape = building.geometry(960)
    every = rooms(15)
    seen = [room.panorama(shape, SEEN + np.array([*room.corner, 0.0]))[:, 0].astype(np.float64) for room in every]
    # Doors and shelves stand before it in some.
    column = np.median(seen, axis=0)
    foot = -np.degrees(np.arctan2(HEIGHT_M, SIZE_M[0] - SEEN[0]))
    elevations = np.degrees(shape.elevation_of_row(np.arange(shape.height)))
    skirting = column[(elevations > foot + 0.1) & (elevations < foot + 0.8)]
    beside = column[np.abs(elevations - foot - 0.35) < 2.0]
    assert len(skirting) >= 3
    assert skirting.mean() < beside.mean() - 8.0


def test_held_out_images_lie_in_the_rooms_and_are_drawn_from_the_seed() -> None:
    every = building.held_out(4, 20, 120)
    again = building.held_out(4, 20, 120)
    for (image, pose), (same, _) in zip(every, again, strict=True):
        assert np.array_equal(image, same)
        inside = [np.all((pose[:2] > room.corner) & (pose[:2] < room.corner + SIZE_M)) for room in rooms(4)]
        assert sum(inside) == 1


@pytest.mark.slow
def test_a_room_is_a_map_that_finds_its_own_images(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    from panoloc_mcl.laboratory.benchmarks.campus.places import error_of
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.robot.observation import VotesModel

    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path))
    path = building.build(1, 120)
    assert building.build(1, 120) == path
    model = PanoramaMap.load(path).observation_model()
    assert isinstance(model, VotesModel)
    assert 900 < len(model.places) < 1100
    errors = [error_of(model, image, pose) for image, pose in building.held_out(1, 5, 120)]
    assert np.median([metres for metres, _ in errors]) < 0.1

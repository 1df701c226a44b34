from dataclasses import replace

import numpy as np
import pytest
from oracles.scenes import grid, references, texture

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings
from panoloc_mcl.robot.synthesis import sweep_profiles
from panoloc_mcl.robot.synthesis.depth import core_rows, with_rows

SETTINGS = VotesSettings()


def deviations(profiles: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.abs(profiles / expected - 1.0)


def test_walls_are_found_where_they_stand(small) -> None:
    far_off = deviations(small.swept.profiles, small.exact.profiles)
    assert np.median(far_off) < 0.06
    assert np.percentile(far_off, 90) < 0.25


def test_depths_do_not_depend_on_the_threads(small) -> None:
    for threads in (2, 5):
        profiles = sweep_profiles(small.references, 0.6, SETTINGS, threads=threads)
        assert np.array_equal(profiles, small.swept.profiles)


def test_more_distances_are_finer(small) -> None:
    chosen = SETTINGS.model_copy(update={"virtual_places": VirtualPlacesSettings(wall_distances=40)})
    finer = sweep_profiles(small.references, 0.6, chosen)
    assert np.median(deviations(finer, small.exact.profiles)) < 0.05


def test_references_at_the_same_place_are_no_neighbours(small) -> None:
    room, geometry = small.room, small.geometry
    positions = grid(2, 2)
    single = sweep_profiles(room.references(geometry, positions), 0.6, SETTINGS)
    # More at each place than neighbours are asked for.
    several = sweep_profiles(room.references(geometry, np.repeat(positions, 6, axis=0)), 0.6, SETTINGS)
    assert np.median(deviations(several[::6], room.profiles(positions, 90))) < 0.1
    assert np.median(deviations(several[::6], single)) < 0.1


def test_a_neighbour_that_shows_another_place_has_no_say(small) -> None:
    """Four neighbours are asked for; three are in the room, the fourth is somewhere else altogether."""
    room, geometry = small.room, small.geometry
    here = room.references(geometry, grid(2, 2))
    elsewhere = references([texture(50 + seed, 36, 90) for seed in range(3)], 80.0 + grid(3, 1))
    both = replace(
        here,
        pixels=np.concatenate([here.pixels, elsewhere.pixels]),
        positions=np.concatenate([here.positions, elsewhere.positions]),
        names=here.names + elsewhere.names,
    )
    profiles = sweep_profiles(both, 0.6, SETTINGS)
    assert np.isfinite(profiles).all()
    assert np.median(deviations(profiles[:4], room.profiles(here.positions, 90))) < 0.08


def test_a_ceiling_does_not_move_the_walls(small) -> None:
    """Rows above 30 degrees show whatever hangs there, at a height of its own."""
    room, high = small.room, PanoramaGeometry(90, 84, -50.0, 75.0)
    there = room.references(high, grid(3, 2))
    elevations = np.degrees(high.elevation_of_row(np.arange(84)))
    pixels = there.pixels.copy()
    pixels[:, elevations > 31.0] = texture(9, int((elevations > 31.0).sum()), 90)
    low = with_rows(there, core_rows(high))
    with_ceiling = sweep_profiles(replace(there, pixels=pixels), 0.6, SETTINGS)
    assert np.array_equal(with_ceiling, sweep_profiles(low, 0.6, SETTINGS))


def test_progress_counts_the_references(small) -> None:
    calls: list[tuple[int, int, str]] = []
    sweep_profiles(small.references, 0.6, SETTINGS, lambda *call: calls.append(call), threads=2)
    assert [done for done, _, _ in calls] == list(range(1, 7))
    assert {(total, what) for _, total, what in calls} == {(6, "depth of references")}


@pytest.mark.parametrize("height", [0.3, 1.2])
def test_profiles_lie_within_the_distances_tried(small, height: float) -> None:
    """Also with a height that is wrong, which no distance fits."""
    profiles = sweep_profiles(small.references, height, SETTINGS)
    assert profiles.min() > 0.2
    assert profiles.max() < 25.0

import numpy as np
import pytest
from oracles.rooms import BareRoom

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.depth import with_rows
from panoloc_mcl.robot.synthesis.explained_rows import all_tell_depth, explained_rows

POSITIONS = [(x, y) for x in (0.0, 0.6, 1.2) for y in (0.0, 0.5, 1.0)]


def test_a_field_that_ends_below_the_ceiling_is_used_whole() -> None:
    references = BareRoom().references(PanoramaGeometry(90, 40, -50.0, 25.0), POSITIONS)
    rows = explained_rows(references, VotesSettings())
    assert rows == slice(0, 40)
    assert with_rows(references, rows) is references


def test_a_ceiling_is_left_out_and_walls_are_kept() -> None:
    geometry = PanoramaGeometry(120, 90, -90.0, 90.0)
    references = BareRoom().references(geometry, POSITIONS)
    elevations = np.degrees(geometry.elevation_of_row(np.arange(90)))
    pixels = references.pixels.copy()
    # Above 50 degrees something that is another from every place, and below -70 degrees the robot's own feet.
    noise = np.random.default_rng(0).integers(40, 220, pixels.shape, dtype=np.uint8)
    pixels[:, elevations > 50.0] = noise[:, elevations > 50.0]
    pixels[:, elevations < -70.0] = noise[:1, elevations < -70.0]
    changed = type(references)(**{**vars(references), "pixels": pixels})
    rows = explained_rows(changed, VotesSettings())
    kept = with_rows(changed, rows)
    assert 30.0 <= kept.geometry.elevation_top_deg <= 54.0
    assert -74.0 <= kept.geometry.elevation_bottom_deg <= -60.0
    assert np.array_equal(kept.pixels, pixels[:, rows])
    assert kept.geometry.elevation_of_row(0) == pytest.approx(geometry.elevation_of_row(rows.start))


def test_zenith_and_nadir_are_left_out_however_well_they_are_explained() -> None:
    geometry = PanoramaGeometry(120, 90, -90.0, 90.0)
    references = BareRoom().references(geometry, POSITIONS)
    kept = with_rows(references, explained_rows(references, VotesSettings()))
    assert -60.0 <= kept.geometry.elevation_bottom_deg <= -56.0
    assert kept.geometry.elevation_top_deg <= 60.0


def test_depth_is_told_by_high_rows_where_they_show_the_same_walls() -> None:
    geometry = PanoramaGeometry(120, 70, -60.0, 80.0)
    high = BareRoom().references(geometry, POSITIONS)
    assert all_tell_depth(high, VotesSettings())
    # What is above 30 degrees stands four times as far: a roof over the walls.
    far = BareRoom(low=(-12.0, -12.0), high=(12.0, 12.0)).references(geometry, POSITIONS)
    above = geometry.elevation_of_row(np.arange(70)) > np.radians(30.0)
    pixels = np.where(above[:, None], far.pixels, high.pixels)
    assert not all_tell_depth(type(high)(**{**vars(high), "pixels": pixels}), VotesSettings())
    # A field without such rows has nothing to choose.
    assert not all_tell_depth(BareRoom().references(PanoramaGeometry(90, 40, -50.0, 25.0), POSITIONS), VotesSettings())


def test_without_a_height_all_rows_stay() -> None:
    references = BareRoom().references(PanoramaGeometry(60, 45, -90.0, 90.0), POSITIONS)
    nobody_knows = type(references)(**{**vars(references), "camera_height_m": None})
    assert explained_rows(nobody_knows, VotesSettings()) == slice(0, 45)

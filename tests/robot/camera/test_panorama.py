import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.errors import CameraError
from panoloc_mcl.robot.geometry import wrap_angle

HALL = PanoramaGeometry(360, 145, -50.0, 25.0)


@given(st.integers(4, 2000), st.floats(-1e4, 1e4))
def test_columns_and_azimuths_are_inverse(width: int, column: float) -> None:
    geometry = PanoramaGeometry(width, 2, -10.0, 10.0)
    back = float(geometry.column_of_azimuth(geometry.azimuth_of_column(column)))
    assert 0.0 <= back < width
    assert abs(math.remainder(back - column, width)) < 1e-6


@given(st.integers(2, 2000), st.floats(-89.0, 0.0), st.floats(0.1, 89.0), st.floats(-50.0, 3000.0))
def test_rows_and_elevations_are_inverse(height: int, bottom: float, top: float, row: float) -> None:
    geometry = PanoramaGeometry(8, height, bottom, top)
    assert float(geometry.row_of_elevation(geometry.elevation_of_row(row))) == pytest.approx(row, abs=1e-6)


def test_columns_run_clockwise_from_the_heading() -> None:
    azimuth = HALL.azimuth_of_column([0, 1, 90, 270])
    assert np.allclose(azimuth, np.radians([0.0, -1.0, -90.0, 90.0]))


def test_the_field_of_view_ends_at_the_outer_edges_of_the_rows() -> None:
    assert np.allclose(np.degrees(HALL.elevation_of_row([-0.5, 144.5])), [25.0, -50.0])
    steps = np.diff(HALL.elevation_of_row(np.arange(145)))
    assert np.allclose(steps, np.radians(-75.0 / 145))


@given(st.floats(-1e6, 1e6))
def test_a_column_always_lies_in_the_image(azimuth: float) -> None:
    column = float(HALL.column_of_azimuth(azimuth))
    assert 0.0 <= column < 360.0
    assert abs(float(wrap_angle(HALL.azimuth_of_column(column) - azimuth))) < 1e-6


@pytest.mark.parametrize(
    ("arguments", "word"),
    [((3, 10, -10.0, 10.0), "size"), ((8, 1, -10.0, 10.0), "size"), ((8, 8, 10.0, -10.0), "elevation_deg"),
     ((8, 8, -91.0, 10.0), "elevation_deg"), ((8, 8, math.nan, 10.0), "elevation_deg")],
)  # fmt: skip
def test_impossible_geometries_are_refused(arguments: tuple[int, int, float, float], word: str) -> None:
    with pytest.raises(CameraError, match=word):
        PanoramaGeometry(*arguments)

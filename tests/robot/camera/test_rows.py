"""Panoramas whose rows are linear in the radius of a mirror or a fisheye, not in elevation."""

import numpy as np
import pytest

from panoloc_mcl.robot.camera import Unwrapper, camera_from_mapping, geometry_of, to_mapping
from panoloc_mcl.robot.errors import CameraError

ELEVATIONS = [-50.0, 25.0]
HEIGHT, WIDTH = 300, 24
UNIFIED = {"kind": "unified", "xi": 0.9, "focal_px": 122.2}
TABLE = {"kind": "table", "points": [[-60.0, 40.0], [-20.0, 110.0], [10.0, 150.0], [30.0, 170.0]]}


def camera(**more):
    return camera_from_mapping({"kind": "panorama", "elevation_deg": ELEVATIONS, **more}, "camera")


def unified_elevation(radius: np.ndarray) -> np.ndarray:
    """Elevation, degrees, of radii under the unified model, by bisection on its formula."""
    low, high = np.full(radius.shape, -89.9), np.full(radius.shape, 40.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        t = np.radians(middle + 90.0)
        above = 122.2 * np.sin(t) / (0.9 + np.cos(t)) < radius
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return low


def test_rows_linear_in_the_radius_of_a_mirror_become_linear_in_elevation() -> None:
    ends = np.radians(np.array([25.0, -50.0]) + 90.0)
    top, bottom = 122.2 * np.sin(ends) / (0.9 + np.cos(ends))
    radius = top + (np.arange(HEIGHT) + 0.5) / HEIGHT * (bottom - top)
    # Each pixel says what elevation it shows.
    image = np.repeat(np.rint(2.0 * (unified_elevation(radius) + 90.0))[:, None], WIDTH, axis=1).astype(np.uint8)
    chosen = camera(rows=UNIFIED)
    panorama = Unwrapper(chosen, (WIDTH, HEIGHT), geometry_of(chosen, (WIDTH, HEIGHT)))(image)
    elevation = 25.0 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 75.0
    assert panorama.pixels[:, 0] / 2.0 - 90.0 == pytest.approx(elevation, abs=0.5)
    plain = Unwrapper(camera(), (WIDTH, HEIGHT), geometry_of(chosen, (WIDTH, HEIGHT)))(image)
    assert np.abs(plain.pixels[:, 0] / 2.0 - 90.0 - elevation).max() > 3.0


def test_a_profile_linear_in_elevation_is_the_default() -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, WIDTH), dtype=np.uint8)
    chosen, plain = camera(rows={"kind": "equiangular", "focal_px": 50.0}), camera()
    panoramas = [Unwrapper(one, (WIDTH, 40), geometry_of(one, (WIDTH, 40)))(image).pixels for one in (chosen, plain)]
    assert panoramas[0] == pytest.approx(panoramas[1], abs=1e-3)


def test_it_is_read_back_as_it_was_written() -> None:
    for chosen in (camera(rows=TABLE), camera(rows="elevation"), camera()):
        assert camera_from_mapping(to_mapping(chosen), "camera") == chosen


@pytest.mark.parametrize(
    "rows", ["radius", {"kind": "unified", "xi": 0.9}, {"kind": "table", "points": [[0.0, 1.0], [10.0, 2.0]]}]
)
def test_rows_that_make_no_sense_are_refused(rows) -> None:
    with pytest.raises(CameraError, match="rows"):
        camera(rows=rows)

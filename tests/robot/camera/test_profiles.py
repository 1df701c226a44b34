from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from panoloc_mcl.robot.camera import Profile, radius_px

PROFILES: list[dict[str, Any]] = [
    {"kind": "unified", "xi": 0.9, "focal_px": 122.2019},
    {"kind": "hyperbolic", "eccentricity": 1.3, "focal_px": 600.0},
    {"kind": "equiangular", "focal_px": 110.0},
    {"kind": "linear", "points": [[-50, 40], [25, 230]]},
    {"kind": "table", "points": [[-60, 20], [-50, 40], [-20, 90], [0, 140], [30, 235]]},
]


def radii(profile: dict[str, Any], elevation_deg: Any) -> np.ndarray:
    return radius_px(TypeAdapter(Profile).validate_python(profile), np.radians(elevation_deg))


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile["kind"])
def test_radius_grows_with_elevation(profile: dict[str, Any]) -> None:
    radius = radii(profile, np.linspace(-50, 25, 200))
    assert np.all(np.isfinite(radius))
    assert np.all(np.diff(radius) > 0.0)


def test_unified_formula() -> None:
    t = np.radians(90.0 + 25.0)
    assert radii(PROFILES[0], 25.0) == pytest.approx(122.2019 * np.sin(t) / (0.9 + np.cos(t)))


@given(st.floats(1.01, 20.0), st.floats(10.0, 1000.0))
def test_hyperbolic_mirror_agrees_with_its_geometry_at_the_horizon(eccentricity: float, focal: float) -> None:
    # With semi-axis 1: the mirror's point level with the inner focus is e^2 - 1 off the axis and 2 e below the outer focus.
    radius = radii({"kind": "hyperbolic", "eccentricity": eccentricity, "focal_px": focal}, 0.0)
    assert radius == pytest.approx(focal * (eccentricity**2 - 1.0) / (2.0 * eccentricity))


def test_unified_has_no_image_beyond_its_fold() -> None:
    assert np.isnan(radii({"kind": "unified", "xi": 0.5, "focal_px": 100.0}, 31.0))
    assert np.isnan(radii({"kind": "unified", "xi": 2.0, "focal_px": 100.0}, 31.0))
    assert np.isfinite(radii({"kind": "unified", "xi": 2.0, "focal_px": 100.0}, 29.0))


def test_linear_and_table_pass_through_their_points() -> None:
    for profile in PROFILES[3:]:
        points = np.array(profile["points"], dtype=float)
        assert np.allclose(radii(profile, points[:, 0]), points[:, 1])


def test_a_table_sees_nothing_beyond_its_ends_and_may_fall() -> None:
    assert np.isnan(radii(PROFILES[4], [-61.0, 31.0])).all()
    upward = radii({"kind": "table", "points": [[90, 0], [30, 60], [0, 100]]}, [90.0, 60.0, 30.0, 0.0])
    assert np.all(np.diff(upward) > 0.0)

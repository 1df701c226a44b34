from typing import Any

import pytest

from panoloc_mcl.robot.camera import OmniCamera, PanoramaCamera, camera_from_mapping, to_mapping
from panoloc_mcl.robot.errors import CameraError
from panoloc_mcl.robot.settings.validation import dump_yaml, parse_yaml

PANORAMA: dict[str, Any] = {"kind": "panorama", "columns": "clockwise", "heading_column": 0, "elevation_deg": [-50, 25]}
OMNI: dict[str, Any] = {
    "kind": "omni",
    "center_px": [239.5, 239.5],
    "valid_radius_px": [28, 237],
    "heading_angle_deg": 90,
    "azimuth": "counterclockwise",
    "profile": {"kind": "unified", "xi": 0.9, "focal_px": 122.2019},
    "panorama": {"size": [360, 145], "elevation_deg": [-50, 25], "columns": "clockwise", "heading_column": 0},
    "height_m": 0.6,
}


def faults_of(data: dict[str, Any]) -> tuple[str, ...]:
    with pytest.raises(CameraError) as caught:
        camera_from_mapping(data, "camera.yaml")
    assert all(line.startswith("camera.yaml: ") and "\n" not in line for line in caught.value.faults)
    return tuple(caught.value.faults)


@pytest.mark.parametrize(("data", "kind"), [(PANORAMA, PanoramaCamera), (OMNI, OmniCamera)])
def test_a_camera_survives_yaml(data: dict[str, Any], kind: type) -> None:
    camera = camera_from_mapping(data, "x")
    assert isinstance(camera, kind)
    assert camera_from_mapping(parse_yaml(dump_yaml(to_mapping(camera)), "x"), "x") == camera


@pytest.mark.parametrize(
    "profile",
    [{"kind": "linear", "points": [[-50, 40], [25, 230]]}, {"kind": "equiangular", "focal_px": 110.0},
     {"kind": "hyperbolic", "eccentricity": 1.3, "focal_px": 600},
     {"kind": "table", "points": [[-60, 20], [0, 140], [30, 235]]}],
)  # fmt: skip
def test_every_profile_survives_yaml(profile: dict[str, Any]) -> None:
    camera = camera_from_mapping({**OMNI, "profile": profile}, "x")
    assert camera_from_mapping(parse_yaml(dump_yaml(to_mapping(camera)), "x"), "x") == camera


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"elevation_deg": [25, -50]}, ["elevation_deg", "bottom < top"]),
        ({"elevation_deg": [-95, 25]}, ["elevation_deg", "-90"]),
        ({"elevation_deg": [float("nan"), 25]}, ["elevation_deg.0", "finite"]),
        ({"columns": "sideways"}, ["columns", "'clockwise' or 'counterclockwise'"]),
        ({"height_m": 0}, ["height_m", "greater than 0"]),
        ({"elevation": [0, 1]}, ["unknown key 'elevation'", "elevation_deg"]),
        ({"kind": "panoramic"}, ["kind = 'panoramic'", "'panorama', 'omni', 'equirectangular' or 'fisheye_pair'"]),
    ],
)
def test_a_faulty_panorama_camera_is_named(change: dict[str, Any], words: list[str]) -> None:
    (line,) = faults_of({**PANORAMA, **change})
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"valid_radius_px": [237, 28]}, ["valid_radius_px", "inner < outer"]),
        ({"center_px": [1.0]}, ["center_px"]),
        ({"profile": {"kind": "unified", "xi": -1, "focal_px": 100}}, ["profile.xi = -1"]),
        ({"profile": {"kind": "unified", "xi": 1}}, ["key 'profile.focal_px' is missing"]),
        ({"profile": {"kind": "unified", "xi": 1, "focal": 1, "focal_px": 9}}, ["'profile.focal'", "did you mean 'focal_px'"]),
        ({"profile": {"kind": "hyperbolic", "eccentricity": 0.5, "focal_px": 100}}, ["profile.eccentricity", "greater than 1"]),
        ({"profile": {"kind": "equiangular", "focal_px": float("inf")}}, ["profile.focal_px", "finite"]),
        ({"profile": {"kind": "table", "points": [[0, 100], [10, 90], [20, 120]]}}, ["profile.points", "sort the points"]),
        ({"profile": {"kind": "table", "points": [[0, 100]]}}, ["profile.points", "at least 2"]),
        ({"profile": {"kind": "linear", "points": [[0, 100], [120, 200]]}}, ["profile.points", "-90..90"]),
        ({"profile": {"kind": "magic"}}, ["profile", "'table'"]),
        ({"profile": {"kind": "equiangular", "focal_px": 1.0}}, ["valid_radius_px", "check profile"]),
        ({"panorama": {"size": [360, 1], "elevation_deg": [-50, 25]}}, ["panorama.size.1 = 1"]),
    ],
)  # fmt: skip
def test_a_faulty_omni_camera_is_named(change: dict[str, Any], words: list[str]) -> None:
    (line,) = faults_of({**OMNI, **change})
    assert all(word in line for word in words), line


def test_every_fault_is_reported_at_once() -> None:
    assert len(faults_of({**OMNI, "valid_radius_px": [5, 1], "azimuth": "left", "height_m": -1})) == 3

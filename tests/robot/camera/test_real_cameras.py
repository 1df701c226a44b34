"""Full spheres, pairs of fisheyes, calibrated lenses, mounts and masks: a smooth world on the sphere comes out where it is."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.camera import Mask, PanoramaGeometry, Unwrapper, camera_from_mapping, geometry_of, to_mapping
from panoloc_mcl.robot.camera.files import camera_with_files
from panoloc_mcl.robot.errors import CameraError

WAVES = np.random.default_rng(1).normal(size=(12, 3)) * 2.0
PHASES = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 12)
GEOMETRY = PanoramaGeometry(180, 60, -60.0, 30.0)


def world(rays: np.ndarray) -> np.ndarray:
    """Grey levels of directions (..., 3); a tenth of a degree changes them by half a level at most."""
    return 128.0 + 18.0 * np.cos(rays @ WAVES.T + PHASES).sum(axis=-1) / 2.0


def directions(azimuth, elevation):
    return np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)


def expected(geometry: PanoramaGeometry, turn: float = 0.0) -> np.ndarray:
    azimuth, elevation = np.meshgrid(
        -2.0 * np.pi * np.arange(geometry.width) / geometry.width + turn,
        np.radians(
            geometry.elevation_top_deg
            - (np.arange(geometry.height) + 0.5)
            * (geometry.elevation_top_deg - geometry.elevation_bottom_deg)
            / geometry.height
        ),
    )
    return world(directions(azimuth, elevation))


def sphere(width: int, mount: Rotation | None = None, heading_column: float | None = None) -> np.ndarray:
    """An equirectangular image of the world, clockwise; its middle (the edge between two columns) looks ahead."""
    ahead = (width - 1) / 2.0 if heading_column is None else heading_column
    column, row = np.meshgrid(np.arange(width), np.arange(width // 2))
    rays = directions(-2.0 * np.pi * (column - ahead) / width, np.pi / 2.0 - (row + 0.5) * 2.0 * np.pi / width)
    return np.rint(world(rays if mount is None else rays @ mount.as_matrix().T)).astype(np.uint8)


def worst(panorama, geometry: PanoramaGeometry = GEOMETRY, turn: float = 0.0) -> float:
    seen = np.ones(geometry.shape, dtype=bool) if panorama.valid is None else panorama.valid
    return float(np.abs(panorama.pixels - expected(geometry, turn))[seen].max())


def test_a_full_sphere_looks_ahead_in_its_middle() -> None:
    camera = camera_from_mapping({"kind": "equirectangular"}, "x")
    for width in (256, 512, 1024):
        panorama = Unwrapper(camera, (width, width // 2), GEOMETRY)(sphere(width))
        assert panorama.valid is None
        assert worst(panorama) < 1.5


def test_a_full_sphere_carries_all_elevations_at_a_size_that_helps() -> None:
    camera = camera_from_mapping({"kind": "equirectangular"}, "x")
    assert geometry_of(camera, (5376, 2688)) == PanoramaGeometry(720, 360, -90.0, 90.0)
    part = camera_from_mapping({"kind": "equirectangular", "elevation_deg": [-60, 30]}, "x")
    assert geometry_of(part, (360, 180)) == PanoramaGeometry(360, 90, -60.0, 30.0)
    whole = geometry_of(camera, (360, 180))
    panorama = Unwrapper(camera, (360, 180), whole)(sphere(360))
    assert worst(panorama, whole) < 1.5


ANGLES = st.floats(-180.0, 180.0)


@settings(max_examples=25, deadline=None)
@given(ANGLES, st.floats(-90.0, 90.0), ANGLES, st.floats(-3.0, 3.0))
def test_any_mount_is_turned_back(yaw: float, pitch: float, roll: float, turn: float) -> None:
    mount = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
    mapping = {"kind": "equirectangular", "mount": {"yaw_deg": yaw, "pitch_deg": pitch, "roll_deg": roll}}
    panorama = Unwrapper(camera_from_mapping(mapping, "x"), (512, 256), GEOMETRY, turn)(sphere(512, mount))
    assert worst(panorama, turn=turn) < 2.0


def test_the_yaw_of_a_mounted_cylinder_turns_its_columns() -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, 360), dtype=np.uint8)
    plain = camera_from_mapping({"kind": "panorama", "elevation_deg": [-50, 25]}, "x")
    turned = camera_from_mapping({"kind": "panorama", "elevation_deg": [-50, 25], "mount": {"yaw_deg": 20}}, "x")
    geometry = geometry_of(plain, (360, 40))
    # What the camera sees ahead lies 20 degrees to the left of the robot's heading.
    assert np.array_equal(Unwrapper(turned, (360, 40), geometry)(image).pixels, np.roll(image, -20, axis=1))


@pytest.mark.parametrize("sizes", [(360, 720), (360, 1080), (720, 1440)])
def test_two_sizes_of_one_panorama_agree_to_a_fiftieth_of_a_degree(sizes: tuple[int, int]) -> None:
    """Centres of pixels lie at integers: at s times the size, heading_column h becomes s (h + 0.5) - 0.5."""
    geometry = PanoramaGeometry(360, 90, -60.0, 30.0)
    small, large = sizes
    unwrapped = []
    for width in sizes:
        scale = width / small
        ahead = scale * (3.0 + 0.5) - 0.5
        camera = camera_from_mapping({"kind": "equirectangular", "heading_column": ahead}, "x")
        unwrapped.append(Unwrapper(camera, (width, width // 2), geometry)(sphere(width, heading_column=ahead)).pixels)
    # The shift between both, by least squares on the gradient along the rows.
    first, second = unwrapped
    slope = 0.5 * (np.roll(first, -1, axis=1) - np.roll(first, 1, axis=1))
    shift = float((slope * (second - first)).sum() / (slope * slope).sum())
    assert abs(shift * 360.0 / geometry.width) < 0.02
    assert large > small


def fisheye(size: int, focal: float, axis: Rotation) -> np.ndarray:
    """An equidistant fisheye (x right, y down, z along the axis), turned by ``axis`` from looking ahead upright."""
    u, v = np.meshgrid(np.arange(size) - (size - 1) / 2.0, np.arange(size) - (size - 1) / 2.0)
    theta = np.hypot(u, v) / focal
    around = np.arctan2(v, u)
    rays = np.stack([np.cos(theta), -np.sin(theta) * np.cos(around), -np.sin(theta) * np.sin(around)], axis=-1)
    return np.rint(world(rays @ axis.as_matrix().T)).astype(np.uint8)


def test_two_fisheyes_are_joined_and_their_joint_shows_nothing() -> None:
    size, focal = 400, 115.0
    lens = {"kind": "kannala_brandt", "fx": focal, "fy": focal, "cx": 199.5, "cy": 199.5}
    mapping = {
        "kind": "fisheye_pair",
        "front": {"lens": lens, "roll_deg": 90},
        "back": {"lens": lens, "roll_deg": -90, "offset_px": [400, 0]},
    }
    camera = camera_from_mapping(mapping, "x")
    front = fisheye(size, focal, Rotation.from_euler("ZYX", [0, 0, 90], degrees=True))
    back = fisheye(size, focal, Rotation.from_euler("ZYX", [180, 0, -90], degrees=True))
    panorama = Unwrapper(camera, (800, 400), GEOMETRY)(np.hstack([front, back]))
    assert worst(panorama) < 1.5
    assert panorama.valid is not None
    sides = [GEOMETRY.width // 4, 3 * GEOMETRY.width // 4]
    assert not panorama.valid[:, sides].any()
    assert panorama.valid.mean() > 0.97
    assert geometry_of(camera, (800, 400)) == PanoramaGeometry(360, 360, -90.0, 90.0)
    assert camera_from_mapping(to_mapping(camera), "y") == camera


@pytest.mark.parametrize("looks", ["up", "down"])
def test_a_calibrated_fisheye_looks_up_or_down(looks: str) -> None:
    size, focal = 501, 140.0
    lens = {"kind": "kannala_brandt", "fx": focal, "fy": focal, "cx": 250.0, "cy": 250.0}
    camera = camera_from_mapping({"kind": "omni", "looks": looks, "lens": lens, "heading_angle_deg": 90}, "x")
    # The robot's heading appears at the top of the image.
    axis = (
        Rotation.from_euler("ZYX", [180, -90, 0], degrees=True) if looks == "up" else Rotation.from_euler("Y", 90, degrees=True)
    )
    band = geometry_of(camera, (size, size))
    assert (band.elevation_top_deg == 90.0) if looks == "up" else (band.elevation_bottom_deg == -90.0)
    field = np.degrees(250.0 / focal)
    assert band.elevation_top_deg - band.elevation_bottom_deg == pytest.approx(field, abs=0.5)
    panorama = Unwrapper(camera, (size, size), band)(fisheye(size, focal, axis))
    assert worst(panorama, band) < 1.5


def test_a_mask_hides_what_it_hides_at_every_heading(tmp_path) -> None:
    import cv2

    mask = np.full((40, 360), 255, dtype=np.uint8)
    mask[30:, 100:140] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    mapping: dict[str, Any] = {"kind": "panorama", "elevation_deg": [-50, 25], "mask": "mask.png"}
    camera = camera_from_mapping(camera_with_files(mapping, tmp_path, "dataset.yaml"), "dataset.yaml")
    image = np.full((40, 360), 99, dtype=np.uint8)
    panorama = Unwrapper(camera, (360, 40), geometry_of(camera, (360, 40)))(image)
    assert panorama.valid is not None
    assert np.array_equal(panorama.valid, mask > 0)
    turned = Unwrapper(camera, (360, 40), geometry_of(camera, (360, 40)), turn=np.radians(-25.0))(image)
    assert turned.valid is not None
    assert np.array_equal(turned.valid, np.roll(mask > 0, -25, axis=1))
    half = Unwrapper(camera, (360, 40), PanoramaGeometry(180, 20, -50.0, 25.0))(image)
    assert half.valid is not None
    assert not half.valid[15:, 50:70].any()
    assert half.valid.mean() == pytest.approx((mask > 0).mean(), abs=0.01)
    # A map keeps the image itself.
    assert camera_from_mapping(to_mapping(camera), "x") == camera


def test_a_mask_of_raw_images_is_unwrapped_with_them() -> None:
    world_part = np.ones((256, 512), dtype=bool)
    world_part[140:180, 200:300] = False
    camera = camera_from_mapping({"kind": "equirectangular", "mask": Mask(world_part)}, "x")
    image = sphere(512)
    image[~world_part] = 7
    panorama = Unwrapper(camera, (512, 256), GEOMETRY)(image)
    assert worst(panorama) < 1.5
    assert panorama.valid is not None
    assert 0.02 < 1.0 - panorama.valid.mean() < 0.09


@pytest.mark.parametrize(
    ("mapping", "size", "words"),
    [
        ({"kind": "equirectangular"}, (640, 480), ["not twice as wide", "kind: panorama"]),
        ({"kind": "equirectangular", "mask": Mask(np.ones((10, 20), dtype=bool))}, (640, 320), ["mask = 20 x 10", "640 x 320"]),
        (
            {"kind": "omni", "looks": "up", "size_px": [640, 480],
             "lens": {"kind": "kannala_brandt", "fx": 150, "fy": 150, "cx": 320, "cy": 240}},
            (1280, 960),
            ["calibrated for 640 x 480", "1280 x 960"],
        ),
        (
            {"kind": "omni", "looks": "up", "panorama": {"size": [90, 20], "elevation_deg": [-80, -40]},
             "lens": {"kind": "kannala_brandt", "fx": 300, "fy": 300, "cx": 320, "cy": 240}},
            (640, 480),
            ["show no elevation", "[-80, -40]"],
        ),
    ],
)  # fmt: skip
def test_images_that_do_not_fit_are_named(mapping: dict[str, Any], size: tuple[int, int], words: list[str]) -> None:
    camera = camera_from_mapping(mapping, "x")
    with pytest.raises(CameraError) as caught:
        Unwrapper(camera, size, geometry_of(camera, size))
    (line,) = caught.value.faults
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"kind": "panorama", "elevation_deg": [-50, 25], "mount": {"x_m": 12}}, ["mount", "x_m = 12", "metre", "far: true"]),
        ({"kind": "panorama", "elevation_deg": [-50, 25], "mask": "no.png"}, ["mask", "no.png", "no such file"]),
        ({"kind": "omni", "file": "no.yaml"}, ["file", "no.yaml", "no such file"]),
        ({"kind": "fisheye_pair", "front": {"file": "a.yaml"}, "back": {"lens": {}}}, ["front.file", "a.yaml", "no such file"]),
        ({"kind": "omni", "file": 3}, ["file = 3", "name of a calibration"]),
    ],
)
def test_faulty_keys_are_named(tmp_path, mapping: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(CameraError) as caught:
        camera_from_mapping(camera_with_files(mapping, tmp_path, "dataset.yaml", "camera."), "dataset.yaml")
    (line,) = caught.value.faults
    assert all(word in line for word in ["dataset.yaml", *words]), line


def test_a_black_mask_is_refused(tmp_path) -> None:
    import cv2

    cv2.imwrite(str(tmp_path / "mask.png"), np.zeros((4, 4), dtype=np.uint8))
    with pytest.raises(CameraError, match="black all over"):
        camera_with_files({"mask": "mask.png"}, tmp_path, "dataset.yaml")


def test_far_mounts_may_be_meant() -> None:
    mapping = {"kind": "panorama", "elevation_deg": [-50, 25], "mount": {"x_m": 2.5, "far": True}}
    camera = camera_from_mapping(mapping, "x")
    poses = np.array([[1.0, 2.0, np.pi / 2.0], [0.0, 0.0, 0.0]])
    assert camera.mounting.camera_poses(poses) == pytest.approx(np.array([[1.0, 4.5, np.pi / 2.0], [2.5, 0.0, 0.0]]))
    assert camera.mounting.base_poses(camera.mounting.camera_poses(poses)) == pytest.approx(poses)

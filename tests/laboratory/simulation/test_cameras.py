"""Cameras of other kinds in the simulator, a robot's body before them, mounts, glossy floors, references along a drive."""

import math

import cv2
import numpy as np
import pytest

pytest.importorskip("mitsuba")

from panoloc_mcl.laboratory.simulation.building import build
from panoloc_mcl.laboratory.simulation.engine.backend import backend
from panoloc_mcl.laboratory.simulation.optics import overlaid, ray_table
from panoloc_mcl.laboratory.simulation.people import Person
from panoloc_mcl.laboratory.simulation.scene import load_scene
from panoloc_mcl.laboratory.simulation.settings import load_simulation
from panoloc_mcl.laboratory.simulation.simulate import Simulation
from panoloc_mcl.laboratory.simulation.world import World, mirrored_share
from panoloc_mcl.robot.camera import PanoramaGeometry, Unwrapper
from panoloc_mcl.robot.camera.mount import Mount
from panoloc_mcl.robot.camera.spec import EquirectangularCamera, FisheyePairCamera, PanoramaCamera
from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import read_dataset

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
SPHERE = EquirectangularCamera(height_m=0.6)
_HALF = {"kind": "kannala_brandt", "fx": 76.0, "fy": 76.0, "cx": 119.5, "cy": 119.5}
PAIR = FisheyePairCamera(height_m=0.6, front={"lens": _HALF}, back={"lens": _HALF, "offset_px": (240.0, 0.0)})
POSE = np.array([0.3, -0.4, 0.6])


def quiet(*_):
    pass


def a_world(tiny_folder, gloss=0.0):
    scene, folder = load_scene(tiny_folder / "tiny_scene.yaml")
    return World(build(scene, folder), "day", backend(), 64, quiet, floor_gloss=gloss)


@pytest.fixture(scope="module")
def world(tiny_folder, simulation_cache):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PANOLOC_CACHE_DIR", str(simulation_cache))
        return a_world(tiny_folder)


def seen_by(world, camera, size, pose=POSE, samples=2):
    """Grey levels without noise, and the canonical panorama that the localizer makes of them."""
    light, seen = world.luminance(ray_table(camera, size, samples), camera.mounting.camera_poses(pose), 0.6)
    image = np.where(seen, 255.0 * np.clip(light / 150.0, 0.0, 1.0) ** 0.45, 0.0).astype(np.uint8)
    return Unwrapper(camera, size, PanoramaGeometry(240, 100, -50.0, 25.0))(image)


@pytest.mark.parametrize(
    ("camera", "size"),
    [
        pytest.param(SPHERE, (480, 240), id="equirectangular"),
        # The rays of a lens are searched for, pixel by pixel.
        pytest.param(PAIR, (480, 240), id="fisheye_pair", marks=pytest.mark.slow),
    ],
)
def test_every_camera_sees_the_same_world(world, camera, size):
    direct, other = seen_by(world, CAMERA, (240, 100)), seen_by(world, camera, size)
    # Off the edges, where half a pixel is a step, and off the strip where both lenses meet.
    calm = cv2.morphologyEx(direct.pixels, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) < 25.0
    if other.valid is not None:
        calm &= cv2.erode(other.valid.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    calm[-3:] = False
    assert calm.mean() > 0.5
    assert np.abs(direct.pixels - other.pixels)[calm].mean() < 3.0
    shifted = np.abs(np.roll(direct.pixels, 6, axis=1) - other.pixels)[calm].mean()
    assert shifted > 2.0 * np.abs(direct.pixels - other.pixels)[calm].mean()


def test_a_mounted_camera_sees_what_its_mount_says(world):
    """Where it sits moves the camera; what it is turned by, the localizer takes out again."""
    mount = Mount(x_m=0.3, y_m=0.1, yaw_deg=25.0, pitch_deg=3.0, roll_deg=-2.0)
    there = compose(POSE, [0.3, 0.1, 0.0])
    direct = seen_by(world, CAMERA, (240, 100), there)
    mounted = seen_by(world, CAMERA.model_copy(update={"mount": mount}), (240, 100))
    assert mounted.valid is not None
    inner = cv2.erode(mounted.valid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    calm = inner & (cv2.morphologyEx(direct.pixels, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) < 25.0)
    assert calm.mean() > 0.5
    assert np.abs(direct.pixels - mounted.pixels)[calm].mean() < 3.0


def test_a_glossy_floor_mirrors_by_the_law(tiny_folder, world):
    glossy = a_world(tiny_folder, 0.8)
    rays = ray_table(CAMERA, (120, 50), 1)
    matt, _ = world.luminance(rays, POSE, 0.6)
    mirrored, _ = glossy.luminance(rays, POSE, 0.6)
    low = mirrored - matt
    assert (low > -1e-9).all()
    # The oracle: a camera as far below the floor, looking up through it, sees what is mirrored.
    row, column = 45, 30
    down = -rays.directions[row * 120 + column]
    c, s = math.cos(POSE[2]), math.sin(POSE[2])
    along = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ -down
    foot = np.array([POSE[0], POSE[1], 0.6]) + 0.6 / -along[2] * along
    up = along * [1.0, 1.0, -1.0]
    seen = world._along(foot + 1e-3 * up, up[None], ())[0]
    assert low[row, column] == pytest.approx(0.8 * mirrored_share(np.array([down[2]]))[0] * seen, rel=0.02)
    # Walls mirror nothing.
    np.testing.assert_array_equal(mirrored[:12], matt[:12])
    person = (Person((1.2, 0.0), 0.0, 0.3, 0.0),)
    with_person, _ = glossy.luminance(rays, POSE, 0.6, person)
    only_person, _ = world.luminance(rays, POSE, 0.6, person)
    assert not np.allclose(with_person - only_person, low)


def test_a_body_lies_before_everything_and_takes_the_light_of_the_place():
    light, seen = np.full((4, 6), 40.0), np.ones((4, 6), dtype=bool)
    body = np.zeros((4, 6, 2), dtype=np.uint8)
    body[3] = 255
    covered = overlaid(light, seen, body, 2.2)
    np.testing.assert_allclose(covered[:3], 40.0)
    np.testing.assert_allclose(covered[3], 40.0 / 0.3)
    np.testing.assert_allclose(overlaid(0.1 * light, seen, body, 2.2), 0.1 * covered)


@pytest.mark.slow
def test_body_mount_and_drive_in_a_data_set(tiny_folder, tmp_path):
    body = np.zeros((25, 60, 4), dtype=np.uint8)
    body[20:] = (0, 0, 0, 255)
    cv2.imwrite(str(tmp_path / "body.png"), body)
    overrides = [
        f"body={tmp_path / 'body.png'}",
        "camera={kind: panorama, elevation_deg: [-50, 25], height_m: 0.6, mount: {x_m: 0.1, yaw_deg: 30}}",
        "references_drive={frames: 7, every_s: 1.5, drive: {kind: wander}}",
        "sequences=[{name: day, light: day, frames: 2}]",
    ]
    config = load_simulation(tiny_folder / "tiny.yaml", overrides)
    dataset = read_dataset(Simulation(config, tiny_folder).run(tmp_path / "out", quiet, quiet))
    assert len(dataset.references) == 7
    assert len(np.unique(np.round(dataset.references.poses[:, 2], 3))) > 2
    assert dataset.camera.mount.x_m == 0.1
    for file in (*dataset.references.files, *dataset.sequences["day_00"].files):
        # Black, but for the noise of the sensor.
        assert read_image(file)[20:].mean() < 12.0
        assert read_image(file)[:20].mean() > 25.0
    read = read_references(dataset.references)
    np.testing.assert_allclose(read.positions, compose(dataset.references.poses, [0.1, 0.0, 0.0])[:, :2], atol=1e-9)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("body=missing.png", "no such file"),
        ("body=grey.png", "has no transparency"),
        ("body=small.png", "8 x 5 pixels where images have 60 x 25"),
        ("references_drive={frames: 1}", "references_drive.frames = 1"),
        (
            "references_drive={frames: 5, drive: {kind: patrol, waypoints: [[0, 0], [9, 0]]}}",
            "references_drive.drive.waypoints.1",
        ),
        ("floor_gloss=2", "floor_gloss = 2"),
    ],
)
def test_bad_input_is_one_line(tiny_folder, tmp_path, capsys, override, said):
    for name in ("tiny.yaml", "tiny_scene.yaml"):
        (tmp_path / name).write_text((tiny_folder / name).read_text())
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((25, 60), np.uint8))
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((5, 8, 4), np.uint8))
    code = main(["simulate", str(tmp_path / "tiny.yaml"), "-o", str(tmp_path / "out"), "--set", override])
    error = capsys.readouterr().err.strip().splitlines()
    assert code == 2
    assert any(said in line for line in error)
    assert not (tmp_path / "out").exists()

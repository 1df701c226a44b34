"""The physics of light and geometry, and a data set made, stopped, resumed and made again. Needs Mitsuba."""

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mitsuba")

from panoloc_mcl.laboratory.simulation.building import build
from panoloc_mcl.laboratory.simulation.engine.backend import backend
from panoloc_mcl.laboratory.simulation.optics import expose, ray_table
from panoloc_mcl.laboratory.simulation.people import Person
from panoloc_mcl.laboratory.simulation.scene import load_scene
from panoloc_mcl.laboratory.simulation.settings import Sensor, load_simulation
from panoloc_mcl.laboratory.simulation.simulate import MARK, Simulation
from panoloc_mcl.laboratory.simulation.world import World, illuminance
from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.camera.spec import OmniCamera, PanoramaCamera, camera_from_mapping
from panoloc_mcl.robot.files import UNFINISHED
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import read_dataset

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
OMNI = {
    "kind": "omni",
    "center_px": [239.5, 239.5],
    "valid_radius_px": [28, 237],
    "profile": {"kind": "unified", "xi": 0.9, "focal_px": 122.2019},
    "panorama": {"size": [360, 145], "elevation_deg": [-50, 25]},
    "height_m": 0.6,
}


def quiet(*_):
    pass


@pytest.fixture(scope="module")
def world(tiny_folder, simulation_cache):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PANOLOC_CACHE_DIR", str(simulation_cache))
        scene, folder = load_scene(tiny_folder / "tiny_scene.yaml")
        return World(build(scene, folder), "day", backend(), 64, quiet)


@pytest.mark.slow
def test_a_lamp_lights_as_the_formula_says(tiny_folder):
    text = (tiny_folder / "tiny_scene.yaml").read_text()
    scene, folder = load_scene(tiny_folder / "tiny_scene.yaml")
    black = {
        name: material.model_copy(update={"albedo": 0.01, "pattern": "plain"}) for name, material in scene.materials.items()
    }
    building = build(scene.model_copy(update={"materials": black}), folder)
    lux, outside = illuminance(building, "lamp", np.array([[0.0, 0.0, 0.02], [0.0, 1.2, 0.02]]), backend(), 65536)
    assert "lumen: 6000" in text
    # A square of luminance flux / (pi area), summed over its pieces.
    at = (np.arange(100) + 0.5) / 100 * 0.6 - 0.3
    x, y = np.meshgrid(at, at)
    for found, (px, py) in zip(lux, [(0.0, 0.0), (0.0, 1.2)], strict=True):
        square = (x - px) ** 2 + (y - py) ** 2 + 2.78**2
        expected = 6000.0 / (np.pi * 0.36) * np.sum(2.78**2 / square**2) * (0.36 / at.size**2)
        assert found == pytest.approx(expected, rel=0.05)
    assert outside == 0.0


def test_turning_left_by_90_degrees_shifts_by_90_columns(world):
    rays = ray_table(CAMERA, (360, 145), 2)
    ahead, seen = world.luminance(rays, np.array([0.3, -0.4, 0.0]), 0.6)
    turned, _ = world.luminance(rays, np.array([0.3, -0.4, math.pi / 2]), 0.6)
    # Column c looks along azimuth heading - c.
    sensor = Sensor()
    first, second = (expose(image, seen, sensor, np.random.default_rng(k)) for k, image in enumerate((ahead, turned)))
    third = expose(ahead, seen, sensor, np.random.default_rng(2))
    moved = np.roll(second, -90, axis=1).astype(float)
    noise = np.abs(first - third.astype(float)).mean()
    assert np.abs(first - moved).mean() < 1.02 * noise
    assert np.abs(first - second.astype(float)).mean() > 3.0 * noise


@pytest.mark.slow
@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (-1.0, 0.5, 0.7), (0.5, -1.0, -2.5)])
def test_the_post_stands_where_geometry_says(world, world_with_a_black_post, pose):
    size = (720, 290)
    image, _ = world.luminance(ray_table(CAMERA, size, 2), np.array(pose), 0.6)
    column, row_of_foot = expected_post(pose, size)
    other, _ = world_with_a_black_post.luminance(ray_table(CAMERA, size, 2), np.array(pose), 0.6)
    changed = image > 3.0 * other  # nothing else becomes so much darker
    rows = slice(round(size[1] * 0.2), int(row_of_foot) - 2)
    columns = np.flatnonzero(changed[rows].mean(axis=0) > 0.5)
    middle = np.degrees(np.angle(np.mean(np.exp(2j * np.pi * columns / size[0])))) / 360.0 * size[0]
    assert abs((middle - column + 360) % size[0] - 360) < 0.8
    width = 2.0 * math.asin(0.08 / math.hypot(2.0 - pose[0], 2.0 - pose[1])) / (2.0 * math.pi) * size[0]
    assert len(columns) == pytest.approx(width, abs=1.6)


def expected_post(pose, size):
    azimuth = math.atan2(2.0 - pose[1], 2.0 - pose[0]) - pose[2]
    away = math.hypot(2.0 - pose[0], 2.0 - pose[1]) - 0.08
    elevation = math.degrees(math.atan2(-0.6, away))
    return (-azimuth / (2.0 * math.pi) * size[0]) % size[0], (25.0 - elevation) / 75.0 * size[1] - 0.5


@pytest.fixture(scope="module")
def world_with_a_black_post(world):
    scene = world.building.scene
    materials = {**scene.materials, "shiny": scene.materials["shiny"].model_copy(update={"albedo": 0.01})}
    return World(build(scene.model_copy(update={"materials": materials})), "day", backend(), 64, quiet)


def test_an_omnidirectional_image_unwrapped_is_the_panorama(world):
    omni = camera_from_mapping(OMNI, "test")
    assert isinstance(omni, OmniCamera)
    pose, sensor = np.array([0.3, -0.4, 0.6]), Sensor()
    panorama, seen = world.luminance(ray_table(CAMERA, (360, 145), 3), pose, 0.6)
    direct = expose(panorama, seen, sensor, np.random.default_rng(1)).astype(float)
    raw, seen = world.luminance(ray_table(omni, (480, 480), 3), pose, 0.6)
    image = expose(raw, seen, sensor, np.random.default_rng(2))
    unwrapper = Unwrapper(omni, (480, 480), world_geometry())
    unwrapped = unwrapper(image)
    valid = np.ones(direct.shape, dtype=bool) if unwrapped.valid is None else unwrapped.valid
    rows = valid.all(axis=1)
    assert rows.mean() > 0.9
    scores = [np.corrcoef(np.roll(unwrapped.pixels, k, axis=1)[rows].ravel(), direct[rows].ravel())[0, 1] for k in range(-4, 5)]
    assert int(np.argmax(scores)) == 4
    assert scores[4] >= 0.97


def world_geometry():
    from panoloc_mcl.robot.camera import PanoramaGeometry

    return PanoramaGeometry(360, 145, -50.0, 25.0)


def test_people_hide_what_is_behind_them(world):
    rays, pose = ray_table(CAMERA, (360, 145), 1), np.array([-1.0, 0.0, 0.0])
    empty, _ = world.luminance(rays, pose, 0.6)
    person, _ = world.luminance(rays, pose, 0.6, (Person((0.5, 0.0), math.pi / 2, 0.3, 0.0),))
    changed = np.flatnonzero((empty != person).any(axis=0))
    azimuth = np.abs((changed + 180) % 360 - 180)
    assert 5 <= azimuth.max() <= 20
    hidden, _ = world.luminance(rays, pose, 0.6, (Person((4.0, 0.0), 0.0, 0.3, 0.0),))
    assert np.array_equal(hidden, empty)  # behind the wall


def test_exposure_is_fixed_and_noise_is_the_sensors():
    sensor, seen = Sensor(), np.ones((200, 200), dtype=bool)
    flat = np.full((200, 200), 0.25 * sensor.full_scale_lux / math.pi)
    image = expose(flat, seen, sensor, np.random.default_rng(0)).astype(float)
    assert image.mean() == pytest.approx(255.0 * 0.25 ** (1 / 2.2), abs=0.3)
    electrons = 0.25 * sensor.full_well
    slope = 255.0 / 2.2 * 0.25 ** (1 / 2.2 - 1) / sensor.full_well
    assert image.std() == pytest.approx(math.hypot(math.sqrt(electrons + sensor.read_noise**2) * slope, 0.29), rel=0.05)
    darker = expose(0.5 * flat, seen, sensor, np.random.default_rng(0)).astype(float)
    assert darker.mean() == pytest.approx(255.0 * 0.125 ** (1 / 2.2), abs=0.3)
    automatic = expose(0.5 * flat, seen, sensor, np.random.default_rng(0), auto_exposure=True)
    assert automatic.mean() == pytest.approx(expose(flat, seen, sensor, np.random.default_rng(0), True).mean(), abs=0.5)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def run(tiny_folder, out, *overrides, progress=quiet):
    config = load_simulation(tiny_folder / "tiny.yaml", list(overrides))
    return Simulation(config, tiny_folder).run(out, progress, quiet)


@pytest.fixture(scope="module")
def made(tiny_folder, tmp_path_factory, simulation_cache):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PANOLOC_CACHE_DIR", str(simulation_cache))
        return run(tiny_folder, tmp_path_factory.mktemp("made") / "data")


def test_the_layout_is_that_of_recorded_data(made):
    dataset = read_dataset(made)
    assert len(dataset.references) == 9
    assert list(dataset.sequences) == ["day_00", "lamp_00"]
    day = dataset.sequences["day_00"]
    assert len(day) == 3
    assert day.odometry is not None
    assert not np.isin(day.times, day.odometry.times).any()
    assert day.groundtruth is not None
    assert not (made / MARK).exists()


def test_one_seed_one_data_set(made, tiny_folder, tmp_path):
    again = contents(run(tiny_folder, tmp_path / "again"))
    assert again == contents(made)
    other = contents(run(tiny_folder, tmp_path / "other", "seed=6"))
    assert other.keys() == again.keys()
    assert all(other[name] != again[name] for name in again if name.endswith((".png", "groundtruth.tum", "odometry.tum")))


@pytest.mark.parametrize("after", [1, 9, 11])
def test_stopped_and_resumed(made, tiny_folder, tmp_path, after):
    def stop(done, total, what):
        if what == "frames" and done == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(tiny_folder, tmp_path / "data", progress=stop)
    assert not (tmp_path / "data" / "dataset.yaml").exists()
    kept = len(list((tmp_path / "data").rglob("*.png")))
    assert kept >= after - 1  # the frame at hand is lost at most
    rendered = []
    run(tiny_folder, tmp_path / "data", progress=lambda done, total, what: rendered.append((done, total, what)))
    assert contents(tmp_path / "data") == contents(made)


@pytest.mark.slow
def test_killed_without_warning(made, tiny_folder, tmp_path, simulation_cache):
    program = (
        "import os, signal, sys; from pathlib import Path\n"
        "from panoloc_mcl.laboratory.simulation.settings import load_simulation\n"
        "from panoloc_mcl.laboratory.simulation.simulate import Simulation\n"
        "folder, out = Path(sys.argv[1]), Path(sys.argv[2])\n"
        "def progress(done, total, what):\n"
        "    if what == 'frames' and done == 10: os.kill(os.getpid(), getattr(signal, 'SIGKILL', signal.SIGTERM))\n"
        "Simulation(load_simulation(folder / 'tiny.yaml'), folder).run(out, progress, print)\n"
    )
    out, path = tmp_path / "data", os.pathsep.join(filter(None, sys.path))
    child = subprocess.run(
        [sys.executable, "-c", program, tiny_folder, out], env={**os.environ, "PYTHONPATH": path}, check=False
    )
    assert child.returncode not in (0, 1)
    assert len(list(out.rglob("*.png"))) >= 9
    # What is left when the end comes while a file is written.
    (out / "references" / f".ref_009.png.ab12_x9z{UNFINISHED}").write_bytes(b"half")
    assert contents(run(tiny_folder, out)) == contents(made)


def test_killed_at_the_very_end_and_at_the_very_beginning(made, tiny_folder, tmp_path):
    out = tmp_path / "data"
    out.mkdir()
    (out / f".{MARK}.ab12_x9z{UNFINISHED}").write_text("half")
    assert contents(run(tiny_folder, out)) == contents(made)
    simulation = Simulation(load_simulation(tiny_folder / "tiny.yaml"), tiny_folder)
    (out / "dataset.yaml").unlink()
    (out / MARK).write_text(simulation.said)
    shutil.copy(made / "dataset.yaml", out)
    assert contents(run(tiny_folder, out)) == contents(made)


def test_only_its_own_half_is_resumed(tiny_folder, made, tmp_path, capsys):
    config, out = str(tiny_folder / "tiny.yaml"), tmp_path / "data"
    assert main(["simulate", config, "-o", str(made)]) == 2
    assert "already holds a data set" in capsys.readouterr().err
    out.mkdir()
    (out / MARK).write_text(json.dumps({}))
    assert main(["simulate", config, "-o", str(out)]) == 2
    assert "of another configuration" in capsys.readouterr().err
    (out / MARK).unlink()
    (out / "mine.txt").write_text("mine")
    assert main(["simulate", config, "-o", str(out)]) == 2
    assert "is not empty" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("scene=hal", "no such scene"),
        ("references_light=dusk", "references_light = 'dusk': scene 'tiny' has no such light"),
        ("sequences=[{name: a, light: dusk, frames: 2}]", "sequences.0.light = 'dusk': scene"),
        ("references_light=night", "below the horizon"),
        ("sequences=[{name: a, light: day, frames: 2, drive: {kind: patrol, waypoints: [[0, 0], [9, 0]]}}]", "lies outside"),
        ("sequences=[{name: a, light: day, frames: 2, drive: {kind: patrol}}]", "patrol needs waypoints"),
        ("sequences=[{name: a, light: day, frame: 2}]", "did you mean 'frames'"),
        ("camera={kind: panorama, elevation_deg: [-50, 25]}", "camera.height_m is missing"),
        ("size=[2, 1]", "size"),
    ],
)
def test_bad_input_is_one_line(tiny_folder, tmp_path, capsys, override, said):
    code = main(["simulate", str(tiny_folder / "tiny.yaml"), "-o", str(tmp_path / "out"), "--set", override])
    error = capsys.readouterr().err.strip().splitlines()
    assert code == 2
    assert any(said in line for line in error)
    assert not (tmp_path / "out").exists()


def test_a_camera_inside_a_mesh(tiny_folder, tmp_path, capsys):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.7, 0.7, 1.2)).export(tmp_path / "thing.ply")
    text = (tiny_folder / "tiny_scene.yaml").read_text()
    (tmp_path / "tiny_scene.yaml").write_text(text + "  - {kind: mesh, file: thing.ply, place: [1, 1, 0.6, 0]}\n")
    (tmp_path / "tiny.yaml").write_text((tiny_folder / "tiny.yaml").read_text())
    assert main(["simulate", str(tmp_path / "tiny.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert "the camera is inside a thing" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "override",
    [
        "camera={kind: panorama, elevation_deg: [-50, 25], height_m: 3.5}",
        "sequences=[{name: a, light: day, frames: 1, height_change_m: 0.9}]",
    ],
)
def test_a_camera_above_the_ceiling(tiny_folder, tmp_path, capsys, override):
    # A room in which a tall robot would look out of the roof.
    text = (tiny_folder / "tiny_scene.yaml").read_text().replace("z: 3, material", "z: 1.4, material")
    (tmp_path / "tiny_scene.yaml").write_text(text)
    (tmp_path / "tiny.yaml").write_text((tiny_folder / "tiny.yaml").read_text())
    assert main(["simulate", str(tmp_path / "tiny.yaml"), "-o", str(tmp_path / "out"), "--set", override]) == 2
    assert "the camera is above a ceiling or a roof" in capsys.readouterr().err


def test_a_full_disk(tiny_folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 1000})())
    assert main(["simulate", str(tiny_folder / "tiny.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert "free on the disk" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

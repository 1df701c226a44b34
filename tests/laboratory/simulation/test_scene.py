"""Scenes as data: what is shipped can be read, what is wrong is named; no renderer needed."""

import numpy as np
import pytest

from panoloc_mcl.laboratory.simulation.building import build
from panoloc_mcl.laboratory.simulation.drive import FreeSpace, RoadMap, reference_poses, reported, wander
from panoloc_mcl.laboratory.simulation.patches import PatchList, assemble, look_up
from panoloc_mcl.laboratory.simulation.scene import SHIPPED, Light, Site, load_scene
from panoloc_mcl.laboratory.simulation.settings import Drive, Odometry
from panoloc_mcl.laboratory.simulation.sun import elevation_deg, light_of, sun_direction
from panoloc_mcl.robot.errors import ConfigError


@pytest.mark.parametrize(("name", "count"), [("hall", 42), ("office", 225), ("closet", 9)])
def test_shipped_scenes_stand(name, count):
    scene, folder = load_scene(name)
    building = build(scene, folder)
    places = reference_poses(FreeSpace(building, 0.7))
    assert len(places) == count
    for light in scene.lights:
        light_of(scene, light)
    roads = RoadMap(FreeSpace(building, 0.7), places)
    assert len(roads.reachable(0)) == len(places)


def test_all_shipped_scenes_are_tested():
    assert sorted(SHIPPED) == ["closet", "hall", "office"]


def test_the_hall_is_the_papers():
    scene, folder = load_scene("hall")
    places = reference_poses(FreeSpace(build(scene, folder), 0.7))
    assert sorted(map(tuple, places[:, :2])) == sorted((float(x), float(y)) for x in range(6) for y in range(7))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("material: dull}", "material: dul}", "unknown material 'dul'"),
        ("kind: cylinder", "kind: cylindr", "kind must be one of"),
        ("radius_m: 0.08", "radius: 0.08", "unknown key 'objects.7.radius'; did you mean 'radius_m'"),
        ("at_m: 2, width_m: 2,", "at_m: 5, width_m: 2,", "does not fit a wall of 6 m"),
        ("clearance_m: 0.2", "clearance_m: 20", "no place keeps clearance_m"),
    ],
)
def test_what_is_wrong_is_named(tiny_folder, tmp_path, old, new, said):
    text = (tiny_folder / "tiny_scene.yaml").read_text()
    assert old in text
    (tmp_path / "scene.yaml").write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=said):
        reference_poses(FreeSpace(build(load_scene(tmp_path / "scene.yaml")[0]), 0.7))


def test_unknown_scene_and_missing_mesh(tiny_folder, tmp_path):
    with pytest.raises(ConfigError, match="no such scene; known: hall, office"):
        load_scene("hal")
    text = (tiny_folder / "tiny_scene.yaml").read_text() + "  - {kind: mesh, file: sofa.glb}\n"
    (tmp_path / "scene.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"objects.9.file = .*sofa.glb': no such file"):
        build(*load_scene(tmp_path / "scene.yaml"))


@pytest.mark.parametrize("ending", ["obj", "ply", "glb"])
def test_meshes_of_the_user(tiny_folder, tmp_path, ending):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.5, 0.5, 1.0)).export(tmp_path / f"thing.{ending}")
    text = (tiny_folder / "tiny_scene.yaml").read_text()
    (tmp_path / "scene.yaml").write_text(
        text + f"  - {{kind: mesh, file: thing.{ending}, place: [1, 1, 0.5, 0], albedo: 0.3}}\n"
    )
    scene, folder = load_scene(tmp_path / "scene.yaml")
    building = build(scene, folder)
    without = build(load_scene(tiny_folder / "tiny_scene.yaml")[0])
    assert len(building.patches) == len(without.patches) + 12
    space = FreeSpace(building, 0.7)
    assert space.distance(np.array([[0.9, 0.9]]))[0] < 0.16  # on the rim of it
    (tmp_path / f"thing.{ending}").write_text("nothing of the kind")
    with pytest.raises(ConfigError, match=r"cannot be read as a mesh|holds no triangles"):
        build(scene, folder)


def test_things_that_are_moved(tiny_folder):
    scene, _ = load_scene(tiny_folder / "tiny_scene.yaml")
    origin = build(scene).patches.origin
    assert np.array_equal(origin, build(scene, moved=0.0, seed=3).patches.origin)
    moved = build(scene, moved=1.0, seed=3).patches.origin
    changed = np.any(origin != moved, axis=1)
    assert changed.sum() == 12
    assert np.abs(origin - moved).max() < 1.5
    assert np.array_equal(moved, build(scene, moved=1.0, seed=3).patches.origin)


def test_the_sun():
    site = Site(latitude_deg=47.0, day_of_year=172, north_deg=90.0)
    assert elevation_deg(site, 12.0) == pytest.approx(90.0 - 47.0 + 23.45, abs=0.05)
    south = sun_direction(site, 12.0)
    assert south[0] == pytest.approx(0.0, abs=1e-9)
    assert south[1] < 0.0  # the map's y axis points north
    morning, evening = sun_direction(site, 8.0), sun_direction(site, 16.0)
    assert morning[0] > 0.0 > evening[0]  # it rises in the east, which is +x
    assert np.linalg.norm(morning) == pytest.approx(1.0)
    turned = sun_direction(site.model_copy(update={"north_deg": 0.0}), 12.0)
    assert turned[0] == pytest.approx(south[1])


def test_lights_that_are_none(tiny_folder):
    scene, _ = load_scene(tiny_folder / "tiny_scene.yaml")
    with pytest.raises(ConfigError, match=r"the sun is .* below the horizon"):
        light_of(scene, "night")
    with pytest.raises(ConfigError, match="has no such light; known: day, lamp, night"):
        light_of(scene, "dusk")
    dark = scene.model_copy(update={"lights": {"dark": Light(sun=0.0, sky=0.0)}})
    with pytest.raises(ConfigError, match="nothing shines"):
        light_of(dark, "dark")


def test_look_up_is_bilinear():
    parts = PatchList()
    ramp = np.arange(12, dtype=np.float32).reshape(3, 4) / np.float32(12)
    parts.add((0, 0, 0), (4, 0, 0), (0, 3, 0), np.full((1, 1), 0.5, np.float32))
    parts.add((0, 0, 1), (4, 0, 0), (0, 3, 0), ramp)
    patches = assemble(parts)
    points = np.array([[0.5, 0.5, 1], [1.0, 0.5, 1], [3.5, 2.5, 1], [2.0, 1.0, 1]])
    s, t = patches.coordinates(points, np.ones(4, dtype=np.int64))
    found = look_up(patches.texels, patches.texture_at, np.ones(4, dtype=np.int64), s, t)
    assert np.allclose(found, [ramp[0, 0], ramp[0, :2].mean(), ramp[2, 3], ramp[:2, 1:3].mean()])


def test_denoising_takes_noise_and_leaves_shadows():
    parts = PatchList()
    parts.add((0, 0, 0), (8, 0, 0), (0, 6, 0), np.full((1, 1), 0.5, np.float32), 0.1)
    parts.add((0, 0, 1), (0.05, 0, 0), (0, 0.05, 0), np.full((1, 1), 0.5, np.float32), 0.1)
    patches = assemble(parts)
    truth = np.full((60, 80), 100.0)
    truth[:, 40:] = 400.0  # the edge of a shadow
    rng = np.random.default_rng(0)
    for deviation, flat in ((30.0, 0.35), (0.0, 0.0)):
        values = np.append(truth + deviation * rng.standard_normal(truth.shape), 7.0)
        found = patches.denoised(values, np.full(values.shape, deviation**2))
        assert found[-1] == 7.0
        error = found[:-1].reshape(truth.shape) - truth
        assert np.abs(error[:, np.r_[:30, 50:80]]).mean() <= flat * deviation
        assert np.abs(error[:, 39:41].mean(axis=0)).max() < 20.0 * (deviation > 0.0) + 1e-9


def test_wandering_keeps_its_distance_and_its_seed():
    scene, folder = load_scene("hall")
    space = FreeSpace(build(scene, folder), 0.7)
    roads = RoadMap(space, reference_poses(space))
    one = wander(roads, 60.0, Drive(), np.random.default_rng(3))
    assert space.is_free(one.poses[:, :2], 0.19).all()
    assert np.hypot(*np.diff(one.poses[:, :2], axis=0).T).max() <= 0.5 * 0.05 + 1e-9
    assert np.array_equal(one.poses, wander(roads, 60.0, Drive(), np.random.default_rng(3)).poses)
    assert not np.array_equal(one.poses, wander(roads, 60.0, Drive(), np.random.default_rng(4)).poses)


def test_odometry_errors_are_those_asked_for():
    scene, folder = load_scene("hall")
    space = FreeSpace(build(scene, folder), 0.7)
    roads = RoadMap(space, reference_poses(space))
    truth = wander(roads, 600.0, Drive(), np.random.default_rng(3))
    times = np.arange(0.0, 600.0, 1 / 6.4)
    exact = reported(truth, times, Odometry(translation_noise=0, rotation_noise=0, drift_deg_per_m=0), np.random.default_rng(1))
    assert np.hypot(*(exact.poses[-1, :2])) == pytest.approx(np.hypot(*(truth.at(times[-1]) - truth.poses[0])[:2]), abs=1e-6)
    noisy = reported(truth, times, Odometry(rotation_noise=0, drift_deg_per_m=0), np.random.default_rng(1))
    steps = [np.hypot(*np.diff(one.poses[:, :2], axis=0).T) for one in (noisy, exact)]
    moving = steps[1] > 1e-3
    assert np.std(steps[0][moving] / steps[1][moving]) == pytest.approx(0.10, rel=0.1)

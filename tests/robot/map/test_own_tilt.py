"""Cameras that lean on their mount: found in the images of a room that is cast ray by ray, and nowhere else."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from oracles.rooms import BareRoom

from panoloc_mcl.robot.camera import Mount, PanoramaCamera, PanoramaGeometry
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.drives import Drive
from panoloc_mcl.robot.map.held_out import pose_of
from panoloc_mcl.robot.map.own_tilt import with_found_tilt
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings

GEOMETRY = PanoramaGeometry(180, 72, -50.0, 25.0)
CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
LEANING = (1.5, -1.3)


@dataclass(frozen=True)
class Room:
    """What a map is built of."""

    references: References
    name: str = "room"


def room(folder: Path, tilt_deg: tuple[float, float], camera: PanoramaCamera = CAMERA, seed: int = 0) -> Room:
    """Twelve references at random headings, by a camera that leans (pitch, roll) on its mount."""
    rng = np.random.default_rng(seed)
    poses = np.array([(x, y, rng.uniform(-np.pi, np.pi)) for x in (0.0, 0.7, 1.4, 2.1) for y in (0.0, 0.6, 1.2)])
    return Room(References(folder, pictures(folder, poses, tilt_deg, seed), poses, camera, (180, 72), "base"))


def pictures(folder: Path, poses: np.ndarray, tilt_deg: tuple[float, float], seed: int = 0) -> tuple[Path, ...]:
    """Files of what a camera that leans sees at poses."""
    world, files = BareRoom(finest_m=0.25, seed=seed), []
    for index, pose in enumerate(poses):
        pixels = world.panorama(GEOMETRY, pose, np.radians(tilt_deg)).pixels.astype(np.uint8)
        files.append(folder / f"{index}.png")
        cv2.imwrite(str(files[-1]), pixels)
    return tuple(files)


@pytest.fixture(scope="module")
def leaning(tmp_path_factory: pytest.TempPathFactory) -> Room:
    return room(tmp_path_factory.mktemp("leaning"), LEANING)


@pytest.fixture(scope="module")
def its_map(leaning: Room) -> PanoramaMap:
    return PanoramaMap.build(leaning)


@pytest.mark.slow
@pytest.mark.parametrize(("tilt", "seed"), [((1.0, 0.0), 1), ((-1.2, 2.0), 2), ((0.0, -3.0), 3), ((5.0, 4.0), 4)])
def test_a_lean_is_found(tilt: tuple[float, float], seed: int, tmp_path: Path) -> None:
    camera, (note,) = with_found_tilt(room(tmp_path, tilt, seed=seed).references, VotesSettings())
    assert (camera.mounting.pitch_deg, camera.mounting.roll_deg) == pytest.approx(tilt, abs=0.15)
    assert "leans on its mount" in note


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_an_upright_camera_is_left_alone(seed: int, tmp_path: Path) -> None:
    assert with_found_tilt(room(tmp_path, (0.0, 0.0), seed=seed).references, VotesSettings()) == (CAMERA, ())


def test_what_is_given_is_kept(leaning: Room, tmp_path: Path) -> None:
    given = CAMERA.model_copy(update={"mount": Mount(pitch_deg=0.5)})
    assert with_found_tilt(room(tmp_path, LEANING, given).references, VotesSettings()) == (given, ())


@pytest.mark.slow
def test_a_map_corrects_its_images_and_later_ones_of_the_same_camera(its_map: PanoramaMap, tmp_path: Path) -> None:
    assert its_map.found_tilt
    mount = its_map.camera.mounting
    assert (mount.pitch_deg, mount.roll_deg) == pytest.approx(LEANING, abs=0.15)
    assert any("leans on its mount" in note for note in its_map.notes)
    its_map.save(tmp_path / "a.panomap")
    loaded = PanoramaMap.load(tmp_path / "a.panomap")
    assert loaded.found_tilt
    assert loaded.camera == its_map.camera
    late = CAMERA.model_copy(update={"time_offset_s": 0.1})
    assert Localizer(loaded, camera=late).unwrapper.camera.mounting == mount
    assert loaded.as_found(late).time_offset_s == 0.1


@pytest.mark.slow
def test_views_of_a_map_that_knows_its_lean_fit_better(its_map: PanoramaMap, leaning: Room) -> None:
    left = PanoramaMap.build(leaning, settings=MapSettings(find_tilt=False))
    assert not left.found_tilt
    assert left.camera == CAMERA

    def errors(one: PanoramaMap) -> float:
        unwrap, model = one.unwrapper(CAMERA, (180, 72)), one.observation_model()
        world, rng, off = BareRoom(finest_m=0.25), np.random.default_rng(3), []
        for pose in np.column_stack([rng.uniform((0.2, 0.2), (1.9, 1.0), (12, 2)), rng.uniform(-3.0, 3.0, 12)]):
            pixels = world.panorama(GEOMETRY, pose, np.radians(LEANING)).pixels
            off.append(np.hypot(*(pose_of(model.observe(unwrap(pixels.astype(np.uint8)))) - pose)[:2]))
        return float(np.median(off))

    assert errors(its_map) < errors(left)


@pytest.mark.slow
def test_other_cameras_are_left_as_they_are(its_map: PanoramaMap) -> None:
    aside = CAMERA.model_copy(update={"mount": Mount(yaw_deg=20.0)})
    assert its_map.as_found(aside) is aside
    assert its_map.as_found(CAMERA, (360, 144)) is CAMERA
    own = CAMERA.model_copy(update={"mount": Mount(roll_deg=1.0)})
    assert its_map.as_found(own) is own


@pytest.mark.slow
def test_where_poses_are_not_mended_nothing_is_looked_for(leaning: Room) -> None:
    built = PanoramaMap.build(leaning, settings=MapSettings(mend=False))
    assert not built.found_tilt
    assert built.camera == CAMERA


@pytest.mark.slow
def test_a_map_of_a_drive_finds_it_too(tmp_path: Path) -> None:
    around = np.linspace(0.0, 2.0 * np.pi, 25)
    poses = np.column_stack([1.0 + 0.9 * np.cos(around), 0.7 + 0.6 * np.sin(around), around + np.pi / 2.0])
    files = pictures(tmp_path, poses, LEANING)
    drive = Drive("round", files, np.arange(25.0), poses, CAMERA, (180, 72))
    built = PanoramaMap.of_drives("round", [drive])
    assert built.found_tilt
    mount = built.camera.mounting
    assert (mount.pitch_deg, mount.roll_deg) == pytest.approx(LEANING, abs=0.25)
    assert any("leans on its mount" in note for note in built.notes)
    assert built.as_found(CAMERA).mounting == mount

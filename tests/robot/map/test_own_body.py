"""A map that leaves the robot out of its own images, and one that leaves everything as it is where nobody can know."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.laboratory.corruptions import corrupt, parse_recipe
from panoloc_mcl.robot.camera import Mask, Mount, PanoramaCamera
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.drives import mapping
from panoloc_mcl.robot.map.held_out import pose_of
from panoloc_mcl.robot.map.own_body import with_found_mask
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.datasets.trajectory import truth_at
from panoloc_mcl.tools.runs.map_drives import drives_of

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
WIDTH, HEIGHT = SIZE = (120, 48)


class Picture:
    """An image in memory, as data sets hand them out."""

    name = "picture.png"
    size = SIZE

    def __init__(self, pixels: np.ndarray) -> None:
        self.pixels = pixels

    def read(self) -> np.ndarray:
        return self.pixels

    def content(self) -> bytes:
        return self.pixels.tobytes()


def pictures(count: int, seed: int = 0, body: bool = True) -> list[Picture]:
    """Smooth textures that have nothing to do with each other, with a striped box at the robot's feet or without."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        image = cv2.GaussianBlur(rng.integers(0, 255, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 2.0)
        image = np.clip(128.0 + 5.0 * (image - 128.0), 0.0, 255.0).astype(np.uint8)
        if body:
            image[30:, 20:50] = (40 + 150 * (np.arange(18) // 3 % 2))[:, None]
        found.append(Picture(image))
    return found


def far_apart(count: int) -> np.ndarray:
    return np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(np.float64)


def test_the_body_is_left_out_and_said_in_one_line() -> None:
    camera, notes = with_found_mask(CAMERA, SIZE, pictures(20), far_apart(20))
    assert camera.mask is not None
    assert (~camera.mask.world[30:, 20:50]).all()
    assert camera.mask.world[:26].all()
    assert camera.model_copy(update={"mask": None}) == CAMERA
    (note,) = notes
    assert "found the robot's body" in note
    assert "dataset.yaml" in note


def test_a_mask_that_somebody_painted_is_kept() -> None:
    painted = CAMERA.model_copy(update={"mask": Mask(np.ones((HEIGHT, WIDTH), dtype=bool))})
    camera, notes = with_found_mask(painted, SIZE, pictures(20), far_apart(20))
    assert camera is painted
    assert notes == ()


@pytest.mark.parametrize(
    ("count", "poses"),
    [
        pytest.param(11, far_apart(11), id="few"),
        pytest.param(40, 0.05 * far_apart(40), id="close together"),
        pytest.param(40, np.zeros((40, 3)), id="standing still"),
    ],
)
def test_images_that_cannot_tell_leave_the_camera_as_it_is(count: int, poses: np.ndarray) -> None:
    camera, notes = with_found_mask(CAMERA, SIZE, pictures(count), poses)
    assert camera is CAMERA
    assert notes == ()


def test_a_robot_that_turns_on_the_spot_tells_itself_from_the_world() -> None:
    turning = np.column_stack([np.zeros((8, 2)), np.arange(8) * np.radians(40.0)])
    assert with_found_mask(CAMERA, SIZE, pictures(8), turning)[0].mask is None
    twice = np.concatenate([turning, turning + np.array([1.0, 0.0, 0.0])])
    assert with_found_mask(CAMERA, SIZE, pictures(16), twice)[0].mask is not None


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(12, 40))
def test_worlds_without_a_body_are_left_alone(seed: int, count: int) -> None:
    assert with_found_mask(CAMERA, SIZE, pictures(count, seed, body=False), far_apart(count))[0] is CAMERA


def test_images_of_many_pixels_are_looked_at_smaller() -> None:
    large = [Picture(cv2.resize(one.pixels, (960, 384), interpolation=cv2.INTER_NEAREST)) for one in pictures(20)]
    camera, _ = with_found_mask(CAMERA, (960, 384), large, far_apart(20))
    assert camera.mask is not None
    assert camera.mask.size == (960, 384)
    assert (~camera.mask.world[240:, 160:400]).all()
    assert camera.mask.world[:200].all()


@pytest.fixture(scope="module")
def with_body(small_room: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The small room, seen past a strut and a laptop."""
    path: Path = tmp_path_factory.mktemp("body") / "data"
    return read_dataset(corrupt(small_room, parse_recipe("body:strong"), 0, path))


@pytest.fixture(scope="module")
def its_map(with_body: Dataset) -> PanoramaMap:
    return PanoramaMap.build(with_body)


def test_a_map_finds_the_body_keeps_it_and_leaves_it_out_of_later_images(
    with_body: Dataset, its_map: PanoramaMap, tmp_path: Path
) -> None:
    assert its_map.found_body
    assert its_map.camera.mask is not None
    assert 0.1 < 1.0 - its_map.camera.mask.world.mean() < 0.35
    assert "found the robot's body" in its_map.notes[0]
    its_map.save(tmp_path / "a.panomap")
    loaded = PanoramaMap.load(tmp_path / "a.panomap")
    assert loaded.found_body
    assert loaded.camera == its_map.camera
    (drive,) = with_body.sequences.values()
    assert drive.camera.mask is None
    assert Localizer(loaded, camera=drive.camera).unwrapper.camera.mask == its_map.camera.mask
    # Stamps that are late do not change what a camera sees.
    late = drive.camera.model_copy(update={"time_offset_s": 0.1})
    assert loaded.as_found(late).mask == its_map.camera.mask
    assert loaded.as_found(late).time_offset_s == 0.1


def test_images_past_the_body_are_read_rightly(with_body: Dataset, its_map: PanoramaMap) -> None:
    (drive,) = with_body.sequences.values()
    unwrap, model = its_map.unwrapper(drive.camera, drive.image_size), its_map.observation_model()
    assert drive.groundtruth is not None
    truth = truth_at(drive.groundtruth, drive.times)
    fields = [model.observe(unwrap(read_image(file))) for file in drive.files]
    off = np.array([pose_of(field) for field in fields]) - truth
    assert np.sum(np.hypot(off[:, 0], off[:, 1]) < 0.25) >= len(off) - 1


def test_another_camera_and_one_with_a_mask_are_left_as_they_are(with_body: Dataset, its_map: PanoramaMap) -> None:
    camera = with_body.references.camera
    other = camera.model_copy(update={"mount": Mount(yaw_deg=20.0)})
    assert its_map.as_found(other) is other
    assert its_map.as_found(camera, (2 * its_map.image_size[0], its_map.image_size[1])) is camera
    own = camera.model_copy(update={"mask": Mask(np.ones(its_map.image_size[::-1], dtype=bool))})
    assert its_map.as_found(own) is own


@pytest.mark.slow
def test_it_can_be_switched_off(with_body: Dataset) -> None:
    built = PanoramaMap.build(with_body, settings=MapSettings(file=None, find_body=False, mend=False))
    assert not built.found_body
    assert built.camera.mask is None


@pytest.mark.slow
def test_without_a_body_nothing_changes(small_room: Dataset) -> None:
    maps = [
        PanoramaMap.build(small_room, settings=MapSettings(file=None, find_body=look, mend=False)) for look in (True, False)
    ]
    assert not maps[0].found_body
    assert maps[0].camera == small_room.references.camera
    assert maps[0].notes == maps[1].notes
    assert all(np.array_equal(maps[0].arrays[name], maps[1].arrays[name]) for name in maps[1].arrays)


def test_drives_have_their_body_left_out_too(with_body: Dataset, small_room: Dataset) -> None:
    for dataset, found in ((with_body, True), (small_room, False)):
        (drive,), _ = drives_of(dataset, ["*"])
        # Twelve images of a short drive count as apart when the way between them is longer.
        longer = replace(drive, odometry=drive.odometry * [3.0, 3.0, 1.0])
        camera, _ = with_found_mask(longer.camera, longer.image_size, longer.files, longer.odometry)
        assert (camera.mask is not None) == found


@pytest.mark.parametrize("look", [True, False])
def test_keyframes_of_drives_are_chosen_and_compared_without_the_body(
    look: bool, with_body: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    handed: list[Any] = []

    class Seen:
        def __init__(self, *given: Any) -> None:
            handed.extend(given)

        def run(self) -> None:
            """Where the drives become a map."""

    monkeypatch.setattr(mapping, "_Mapping", Seen)
    (drive,), _ = drives_of(with_body, ["*"])
    # Poses of one say nothing of those of the other, so both count.
    mapping.map_drives([drive, replace(drive, name="again")], VotesSettings(), MapSettings(file=None, find_body=look))
    drives, notes = handed[0], handed[4]
    assert [one.camera.mask is not None for one in drives] == [look, look]
    assert any("found the robot's body" in note for note in notes) == look

"""Maps that live on, in the small room: a map of one half of it learns the other."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.geometry import angle_difference, compose
from panoloc_mcl.robot.map.drives.meetings import agreed_motion
from panoloc_mcl.robot.map.held_out import Judgement
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.map.updating import update_map
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.runs.map_drives import drives_of


def test_the_motion_that_most_agree_on_is_found_among_wrong_ones():
    rng = np.random.default_rng(0)
    here = np.column_stack([np.linspace(0.0, 6.0, 20), rng.uniform(-1.0, 1.0, 20), rng.uniform(-3.0, 3.0, 20)])
    motion = np.array([2.0, -3.0, 1.2])
    there = compose(motion, here) + rng.normal(0.0, 0.02, (20, 3))
    wrong = rng.permutation(20)[:8]
    there[wrong] += rng.uniform(1.0, 3.0, (8, 3))
    found = agreed_motion(there, here)
    assert found is not None
    assert np.hypot(*(found - motion)[:2]) < 0.2
    assert abs(float(angle_difference(found[2], motion[2]))) < 0.05


def test_two_motions_that_as_many_agree_on_are_none():
    # A corridor that looks the same from both ends.
    here = np.column_stack([np.linspace(0.0, 6.0, 12), np.zeros(12), np.zeros(12)])
    there = here.copy()
    there[6:] = compose(np.array([6.0, 0.0, np.pi]), here[6:])
    assert agreed_motion(there, here) is None


def test_poses_of_one_place_say_nothing():
    here = np.zeros((10, 3))
    assert agreed_motion(here + 1.0, here) is None


@pytest.mark.slow
def test_a_map_learns_what_it_has_not_seen_or_stays_as_it_is(small_room: Dataset):
    references = small_room.references
    near = np.flatnonzero(references.poses[:, 0] < 2.5)
    half = PanoramaMap.build(replace(small_room, references=references.of(near)), settings=MapSettings(file=None, mend=False))
    drives, _ = drives_of(small_room, ["*"])
    done = update_map(half, drives, MapSettings(file=None))
    assert len(done.notes) >= 1
    assert done.notes[-1].startswith(f"drive {drives[0].name}: ")
    if done.changed:
        assert "keyframes added" in done.notes[-1]
        assert len(done.panorama_map.references) == len(done.panorama_map.keyframes)
        assert set(done.panorama_map.keyframes.drives) == {"", drives[0].name}
    else:
        assert done.panorama_map is half


@pytest.fixture(scope="module")
def whole(small_room: Dataset) -> PanoramaMap:
    return PanoramaMap.build(small_room, settings=MapSettings(file=None, mend=False))


@pytest.mark.slow
def test_a_drive_of_another_camera_is_refused_before_anything_is_done(whole: PanoramaMap, small_room: Dataset):
    (drive,), _ = drives_of(small_room, ["*"])
    other = drive.camera.model_copy(update={"elevation_deg": (20.0, 80.0)})
    with pytest.raises(MapError, match="built for another camera"):
        update_map(whole, [replace(drive, camera=other)], MapSettings(file=None))


@pytest.mark.slow
def test_a_drive_in_the_dark_changes_nothing(whole: PanoramaMap, small_room: Dataset, tmp_path: Path):
    (drive,), _ = drives_of(small_room, ["*"])
    dark = tmp_path / "dark.png"
    cv2.imwrite(str(dark), np.zeros(drive.image_size[::-1], np.uint8))
    done = update_map(whole, [replace(drive, files=(dark,) * len(drive.files))], MapSettings(file=None))
    assert done.panorama_map is whole
    assert not done.changed
    assert "no image shows anything" in done.notes[-1]
    assert done.notes[-1].endswith("the map stays as it is")


@pytest.mark.slow
def test_a_drive_through_what_the_map_knows_changes_nothing(whole: PanoramaMap, small_room: Dataset):
    drives, _ = drives_of(small_room, ["*"])
    done = update_map(whole, drives, MapSettings(file=None))
    assert done.panorama_map is whole or "read rightly" in done.notes[-1]


def test_a_map_that_reads_worse_is_known():
    before = Judgement(np.array([0.01, 0.012, 0.011, np.inf]))
    assert not Judgement(np.array([0.011, 0.012, 0.012, np.inf])).is_worse_than(before)
    assert not Judgement(np.array([0.005, 0.006, 0.005, 0.2])).is_worse_than(before)
    # One image in four less, or all less exactly; one in eight may be lost.
    assert Judgement(np.array([0.005, 0.006, np.inf, np.inf])).is_worse_than(before)
    assert not Judgement(np.array([*[0.01] * 7, np.inf])).is_worse_than(Judgement(np.full(8, 0.01)))
    assert Judgement(np.array([*[0.01] * 6, np.inf, np.inf])).is_worse_than(Judgement(np.full(8, 0.01)))
    assert Judgement(np.array([0.02, 0.02, 0.02, 0.02])).is_worse_than(before)
    # Nothing to be judged by says nothing.
    assert not Judgement(np.zeros(0)).is_worse_than(Judgement(np.zeros(0)))

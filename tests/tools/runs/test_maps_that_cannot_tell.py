"""Maps that show a place from one side only, and robots that leave the mapped part: never sure of a wrong pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.tools.datasets import EMBEDDED, Dataset, Sequence, read_dataset, read_image, write_image
from panoloc_mcl.tools.streams import answers, recorded

GEOMETRY = PanoramaGeometry(180, 72, -50.0, 25.0)
_GRID = tuple((float(x), float(y)) for y in range(4) for x in range(5))
_AT = np.array(_GRID)

#: Which of the references the map has.
PARTS = {
    "two": np.array([0, 7]),
    "two far apart": np.array([1, 18]),
    "line along x": np.flatnonzero(_AT[:, 1] == 1),
    "line along y": np.flatnonzero(_AT[:, 0] == 2),
    "diagonal": np.flatnonzero(_AT[:, 0] == _AT[:, 1]),
    "left part": np.flatnonzero(_AT[:, 0] <= 1),
    "lower part": np.flatnonzero(_AT[:, 1] <= 1),
}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path: Path = tmp_path_factory.mktemp("room") / "data"
    return read_dataset(build_room(path, frames=24, geometry=GEOMETRY, grid=_GRID, lights=("noon", "evening")))


@pytest.fixture(scope="module")
def whole_map(room: Dataset) -> PanoramaMap:
    return PanoramaMap.build(room)


def nowhere_sure_and_wrong(room: Dataset, panorama_map: PanoramaMap) -> None:
    model = panorama_map.observation_model()
    for drive in room.sequences.values():
        truth = drive.groundtruth.at(drive.times)
        localizer = Localizer(panorama_map, LocalizerConfig(), model=model)
        for image, estimate in answers(localizer, recorded(drive)):
            if estimate.status is Status.CONVERGED:
                assert np.hypot(*(estimate.pose[:2] - truth[image.index][:2])) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("part", list(PARTS))
def test_it_is_never_sure_and_wrong(part: str, room: Dataset) -> None:
    chosen, whole = PARTS[part], room.references
    references = replace(whole, files=tuple(whole.files[i] for i in chosen), poses=whole.poses[chosen])
    nowhere_sure_and_wrong(room, PanoramaMap.build(replace(room, references=references)))


def patch(folder: Path, count: int, corner: tuple[float, float]) -> Dataset:
    """So many by so many references, 5 cm apart."""
    grid = tuple((corner[0] + 0.05 * x, corner[1] + 0.05 * y) for y in range(count) for x in range(count))
    return read_dataset(build_room(folder, frames=2, geometry=GEOMETRY, grid=grid, lights=("noon",)))


@pytest.mark.slow
def test_a_robot_beyond_a_patch_of_close_references(room: Dataset, tmp_path: Path) -> None:
    close = patch(tmp_path / "patch", 3, (1.0, 1.0))
    nowhere_sure_and_wrong(room, PanoramaMap.build(replace(room, references=close.references)))


@pytest.mark.slow
def test_close_references_read_images_as_well_as_others(tmp_path: Path) -> None:
    """Images from between references that are 5 cm apart; the more of them, the better, or at least no worse."""
    panorama_map = PanoramaMap.build(patch(tmp_path / "patch", 9, (1.0, 1.0)))
    model, between = panorama_map.observation_model(), patch(tmp_path / "between", 3, (1.125, 1.175)).references
    errors = []
    for file, pose in zip(between.files, between.poses, strict=True):
        field = model.observe(panorama_map.unwrapper()(read_image(file)))
        best = field.best_pose if field.measurement is None else field.measurement.pose
        errors.append(np.hypot(*(best - pose)[:2]))
    assert np.median(errors) < 0.02
    assert max(errors) < 0.05


@pytest.mark.slow
def test_near_copies_of_references_make_no_map_worse(room: Dataset, whole_map: PanoramaMap, tmp_path: Path) -> None:
    """A robot that stood while it took references: two noisy copies of each, a few millimetres off."""
    rng, whole = np.random.default_rng(0), room.references
    files, poses = list(whole.files), [whole.poses]
    for copy in range(2):
        for index, file in enumerate(whole.files):
            image = read_image(file)
            files.append(path := tmp_path / f"{copy}_{index}.png")
            write_image(path, np.clip(image + rng.normal(0.0, 3.0, image.shape), 0, 255).astype(np.uint8))
        poses.append(whole.poses + rng.normal(0.0, [0.005, 0.005, 0.002], whole.poses.shape))
    copied = replace(whole, files=tuple(files), poses=np.concatenate(poses))
    crowded_map = PanoramaMap.build(replace(room, references=copied))
    plain, crowded = (errors_in(panorama_map, room.sequences["evening_00"]) for panorama_map in (whole_map, crowded_map))
    assert np.median(crowded) < np.median(plain) + 0.01
    assert np.max(crowded[3:]) < 0.2


def errors_in(panorama_map: PanoramaMap, drive: Sequence) -> list[float]:
    """Of positions, metres."""
    truth = drive.groundtruth.at(drive.times)
    given = answers(Localizer(panorama_map, LocalizerConfig()), recorded(drive))
    return [float(np.hypot(*(estimate.pose - truth[image.index])[:2])) for image, estimate in given]


@pytest.mark.slow
def test_a_foreign_building_is_never_sure(whole_map: PanoramaMap) -> None:
    model, hall = whole_map.observation_model(), read_dataset(EMBEDDED["hall"])
    for name in ("noon_00", "people_00"):
        drive = hall.sequences[name]
        localizer = Localizer(whole_map, LocalizerConfig(), camera=drive.camera, image_size=drive.image_size, model=model)
        statuses = [estimate.status for _, estimate in answers(localizer, recorded(drive))]
        assert len(statuses) > 10
        assert Status.CONVERGED not in statuses

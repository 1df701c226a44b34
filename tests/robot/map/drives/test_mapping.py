"""Maps from drives, on the small room's drive, whose true poses are known, and on drives that cannot become one."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.map.drives import Drive, check_drives
from panoloc_mcl.robot.map.drives.mapping import map_drives
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Keyframes
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.runs.map_drives import drives_of


def a_drive(dataset: Dataset) -> Drive:
    (drive,), notes = drives_of(dataset, ["*"])
    assert notes == []
    return drive


def aligned_errors(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    a, b = found[:, :2] - found[:, :2].mean(axis=0), truth[:, :2] - truth[:, :2].mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    return np.hypot(*(a @ (u @ np.diag([1.0, np.sign(np.linalg.det(u @ v))]) @ v) - b).T)


def with_errors(drive: Drive, rng: np.random.Generator) -> Drive:
    """The drive with odometry that bends to one side and is 3 % short."""
    odometry = drive.odometry.copy()
    steps = np.diff(odometry[:, :2], axis=0) * 0.97
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    bend = np.radians(2.0) * way
    turned = np.stack([np.cos(bend[1:]), np.sin(bend[1:])], axis=-1)
    bent = np.column_stack(
        [turned[:, 0] * steps[:, 0] - turned[:, 1] * steps[:, 1], turned[:, 1] * steps[:, 0] + turned[:, 0] * steps[:, 1]]
    )
    odometry[1:, :2] = odometry[0, :2] + np.cumsum(bent + rng.normal(0.0, 0.01, bent.shape), axis=0)
    odometry[:, 2] += bend
    return replace(drive, odometry=odometry)


@pytest.mark.slow
def test_a_drive_becomes_a_map_that_is_truer_than_its_odometry(small_room: Dataset):
    drive = with_errors(a_drive(small_room), np.random.default_rng(0))
    (recorded,) = small_room.sequences.values()
    mapped = map_drives([drive], VotesSettings(), MapSettings(file=None))
    truth = recorded.groundtruth.at(mapped.keyframes.times)
    before = aligned_errors(mapped.keyframes.given, truth)
    after = aligned_errors(mapped.keyframes.poses, truth)
    assert np.median(after) < 0.4 * np.median(before)
    assert len(mapped.panoramas) == len(mapped.keyframes)
    assert mapped.panoramas.names[0].startswith(f"{drive.name}/")
    assert "keyframes over" in mapped.notes[0]
    # The frame is that of the first keyframe.
    np.testing.assert_allclose(mapped.keyframes.poses[0, :2], drive.odometry[0, :2], atol=1e-3)
    assert abs(float(angle_difference(mapped.keyframes.poses[0, 2], drive.odometry[0, 2]))) < 1e-3


def test_odometry_that_jumps_says_little_and_is_named(small_room: Dataset):
    drive = a_drive(small_room)
    jumped = drive.odometry.copy()
    jumped[6:, 0] += 40.0
    broken = replace(drive, odometry=jumped)
    assert broken.jumps().sum() == 1
    edges = broken.edges(3)
    assert (edges.kinds == ODOMETRY).all()
    assert edges.first[0] == 3
    assert edges.covariances[5, 0, 0] == pytest.approx(1.0)
    assert edges.covariances[4, 0, 0] < 0.1
    (line,) = check_drives([broken])
    assert "jumps 1 times" in line
    assert "39." in line


def test_what_no_map_can_be_made_of_is_said_in_one_line_each(small_room: Dataset):
    drive = a_drive(small_room)
    still = replace(drive, odometry=np.zeros_like(drive.odometry))
    low = replace(drive, camera=drive.camera.model_copy(update={"height_m": None}))
    for drives, words in (([], "at least one drive"), ([still], "hardly moved"), ([low], "camera.height_m")):
        with pytest.raises(MapError, match=words):
            check_drives(drives)
    with pytest.raises(MapError, match="another camera"):
        check_drives([drive, replace(drive, name="b", image_size=(8, 8))])


def test_a_drive_in_the_dark_is_no_map(small_room: Dataset, tmp_path: Path):
    drive = a_drive(small_room)
    dark = tmp_path / "dark.png"
    cv2.imwrite(str(dark), np.zeros(cv2.imread(str(drive.files[0]), cv2.IMREAD_GRAYSCALE).shape, np.uint8))
    with pytest.raises(MapError, match="no image shows anything; a map needs light"):
        map_drives([replace(drive, files=(dark,) * len(drive.files))], VotesSettings(), MapSettings(file=None))


@pytest.mark.slow
def test_drives_that_never_meet_are_left_out_and_named(small_room: Dataset, tmp_path: Path):
    drive = a_drive(small_room)
    # Another place: the same images upside down and mirrored.
    others = []
    for number, file in enumerate(drive.files):
        others.append(tmp_path / f"{number:03d}.png")
        cv2.imwrite(str(others[-1]), np.ascontiguousarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)[::-1, ::-1]))
    elsewhere = replace(drive, name="elsewhere", files=tuple(others))
    mapped = map_drives([drive, elsewhere], VotesSettings(), MapSettings(file=None))
    assert set(mapped.keyframes.drives) == {drive.name}
    assert "drives that never meet the others are left out: elsewhere" in "\n".join(mapped.notes)


@pytest.mark.slow
def test_a_build_that_was_stopped_goes_on_and_gives_the_same(small_room: Dataset, tmp_path: Path):
    drive = with_errors(a_drive(small_room), np.random.default_rng(0))
    made = ([drive], VotesSettings(), MapSettings(file=None))
    whole = map_drives(*made).keyframes

    def told_of(folder: Path, last: int = -1) -> tuple[Keyframes | None, list[str]]:
        """Keyframes, and the works that were told of; stopped at the end of one of them."""
        told: list[str] = []

        def progress(done: int, total: int, what: str) -> None:
            if what != "references" and done == total:
                told.append(what)
                if len(told) == last:
                    raise KeyboardInterrupt

        with suppress(KeyboardInterrupt):
            return map_drives(*made, progress, folder).keyframes, told
        return None, told

    _, works = told_of(tmp_path / "whole")
    assert {"depth of references", "pairs of keyframes"} == set(works)
    for stopped_at in range(1, len(works) + 1):
        path = tmp_path / f"{stopped_at}"
        assert told_of(path, stopped_at)[0] is None
        resumed, told = told_of(path)
        # What was told of last was not kept any more.
        assert told == works[stopped_at - 1 :]
        assert resumed is not None
        np.testing.assert_array_equal(resumed.poses, whole.poses)
        np.testing.assert_array_equal(resumed.covariances, whole.covariances)
        np.testing.assert_array_equal(resumed.edges.measured, whole.edges.measured)
    # Of another drive nothing is taken.
    made = ([replace(drive, odometry=drive.odometry + np.array([0.0, 0.0, 0.1]))], *made[1:])
    assert told_of(path)[1][:2] == works[:2]


@pytest.mark.slow
def test_an_image_that_fits_no_other_is_named_and_placed_by_odometry(small_room: Dataset, tmp_path: Path):
    drive = a_drive(small_room)
    strange = tmp_path / "strange.png"
    size = cv2.imread(str(drive.files[0]), cv2.IMREAD_GRAYSCALE).shape
    cv2.imwrite(str(strange), np.random.default_rng(0).integers(0, 255, size).astype(np.uint8))
    files = tuple(strange if index == 6 else file for index, file in enumerate(drive.files))
    mapped = map_drives([replace(drive, files=files)], VotesSettings(), MapSettings(file=None))
    place = mapped.keyframes.names.index(f"{drive.name}/strange.png")
    assert f"1 keyframes fit no other, first {drive.name}/strange.png" in "\n".join(mapped.notes)
    sds = mapped.keyframes.sds[:, 0]
    assert sds[place] > 2.0 * np.median(sds)

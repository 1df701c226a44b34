from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import angle_difference, between, compose
from panoloc_mcl.tools.datasets import Trajectory
from panoloc_mcl.tools.datasets.dataset import Sequence
from panoloc_mcl.tools.datasets.splice import splice
from panoloc_mcl.tools.evaluation.record import group_of

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0))


def a_sequence(name: str, frames: int, seed: int = 0, *, odometry: bool = True, truth: bool = True) -> Sequence:
    """A drive with exact odometry in a frame of its own, at six measurements a frame."""
    rng = np.random.default_rng([seed, frames])
    period = rng.uniform(0.5, 1.5)
    times = 1.7e9 + 1000.0 * seed + period * (np.arange(frames) + rng.uniform(-0.05, 0.05, frames))
    reports = np.arange(times[0] - 0.3, times[-1] + 0.3, period / 6.0)
    steps = np.column_stack([rng.uniform(0.0, 0.1, len(reports)), np.zeros(len(reports)), rng.uniform(-0.2, 0.2, len(reports))])
    poses = [rng.uniform(-3.0, 3.0, 3)]
    for step in steps[1:]:
        poses.append(compose(poses[-1], step))
    way = Trajectory(reports, np.array(poses))
    return Sequence(
        name=name,
        path=Path(name),
        times=times,
        files=tuple(Path(name) / f"{index:03d}.png" for index in range(frames)),
        camera=CAMERA,
        image_size=(60, 20),
        odometry=Trajectory(reports, between(way.poses[0], way.poses)) if odometry else None,
        groundtruth=Trajectory(times, way.at(times)) if truth else None,
    )


drives = st.lists(st.integers(1, 25), min_size=1, max_size=4).map(
    lambda counts: [a_sequence(f"noon_{index:02d}", count, index) for index, count in enumerate(counts)]
)
cases = given(drives, st.integers(1, 12), st.integers(0, 1000))
quick = settings(max_examples=50, deadline=None)


def pieces_of(spliced: Sequence, kidnapped: np.ndarray) -> list[slice]:
    starts = [0, *np.flatnonzero(kidnapped), len(spliced)]
    return [slice(a, b) for a, b in pairwise(starts)]


def single(sequences: list[Sequence], every: int, seed: int) -> tuple[Sequence, np.ndarray]:
    ((spliced, kidnapped),) = splice(sequences, every, np.random.default_rng(seed))
    return spliced, kidnapped


@quick
@cases
def test_every_frame_is_used_once_at_most(sequences: list[Sequence], every: int, seed: int) -> None:
    spliced, kidnapped = single(sequences, every, seed)
    assert len(set(spliced.files)) == len(spliced.files) == len(spliced.times) == len(kidnapped)
    expected = sum(len(s) if len(s) < every else len(s) // every * every for s in sequences)
    assert len(spliced) == expected
    assert spliced.name == "noon_spliced"


@quick
@cases
def test_time_goes_on_and_the_first_piece_keeps_its_own(sequences: list[Sequence], every: int, seed: int) -> None:
    spliced, kidnapped = single(sequences, every, seed)
    assert np.all(np.diff(spliced.times) > 0.0)
    assert np.all(np.diff(spliced.odometry.times) > 0.0)
    by_file = {file: time for s in sequences for file, time in zip(s.files, s.times, strict=True)}
    original = np.array([by_file[file] for file in spliced.files])
    for piece in pieces_of(spliced, kidnapped):
        assert np.diff(spliced.times[piece]) == pytest.approx(np.diff(original[piece]), abs=1e-5)
    assert np.array_equal(spliced.times[pieces_of(spliced, kidnapped)[0]], original[pieces_of(spliced, kidnapped)[0]])


@quick
@cases
def test_at_each_mark_the_robot_was_carried_away(sequences: list[Sequence], every: int, seed: int) -> None:
    spliced, kidnapped = single(sequences, every, seed)
    assert not kidnapped[0]
    for index in range(1, len(spliced)):
        before, here = spliced.files[index - 1], spliced.files[index]
        follows = before.parent == here.parent and int(here.stem) == int(before.stem) + 1
        assert follows != kidnapped[index]


@quick
@cases
def test_odometry_tells_the_way_within_a_piece_and_nothing_at_a_joint(sequences: list[Sequence], every: int, seed: int) -> None:
    spliced, kidnapped = single(sequences, every, seed)
    at_frames = spliced.odometry.at(spliced.times)
    told = between(at_frames[:-1], at_frames[1:])
    driven = between(spliced.groundtruth.poses[:-1], spliced.groundtruth.poses[1:])
    joint = kidnapped[1:]
    # Stamps of today's date resolve 0.2 microseconds.
    assert np.abs(told[joint]).max(initial=0.0) < 1e-9
    assert np.abs(told[~joint][:, :2] - driven[~joint][:, :2]).max(initial=0.0) < 1e-5
    assert np.abs(angle_difference(told[~joint][:, 2], driven[~joint][:, 2])).max(initial=0.0) < 1e-5
    for index in np.flatnonzero(joint):
        inside = (spliced.odometry.times > spliced.times[index]) & (spliced.odometry.times < spliced.times[index + 1])
        assert not inside.any()


@quick
@cases
def test_the_truth_is_that_of_the_frame(sequences: list[Sequence], every: int, seed: int) -> None:
    spliced, _ = single(sequences, every, seed)
    true = {file: pose for s in sequences for file, pose in zip(s.files, s.groundtruth.poses, strict=True)}
    assert np.array_equal(spliced.groundtruth.times, spliced.times)
    assert spliced.groundtruth.poses == pytest.approx(np.array([true[file] for file in spliced.files]), abs=1e-5)


def test_one_short_sequence_stays_as_it_is() -> None:
    sequence = a_sequence("evening_00", 4)
    spliced, kidnapped = single([sequence], 10, 0)
    assert spliced.files == sequence.files
    assert np.array_equal(spliced.times, sequence.times)
    assert not kidnapped.any()


def test_a_single_frame_and_no_odometry_are_enough() -> None:
    spliced, kidnapped = single(
        [a_sequence("a_0", 1, odometry=False, truth=False), a_sequence("a_1", 1, 1, odometry=False, truth=False)], 5, 0
    )
    assert len(spliced) == 2
    assert kidnapped.tolist() == [False, True]
    assert spliced.odometry is None
    assert spliced.groundtruth is None


@pytest.mark.parametrize("seed", range(20))
def test_two_pieces_of_one_drive_change_places(seed: int) -> None:
    # In their own order nobody would be carried away.
    spliced, kidnapped = single([a_sequence("noon_00", 8)], 4, seed)
    assert spliced.files[0].stem == "004"
    assert kidnapped.tolist() == [False] * 4 + [True] + [False] * 3


def test_each_group_is_spliced_on_its_own_and_the_seed_decides_the_order() -> None:
    sequences = [a_sequence(name, 20, index) for index, name in enumerate(("noon_00", "noon_01", "evening_00", "solo"))]
    results = [splice(sequences, 4, np.random.default_rng(seed)) for seed in (0, 0, 1)]
    names = [spliced.name for spliced, _ in results[0]]
    assert names == ["noon_spliced", "evening_spliced", "solo_spliced"]
    files = [[spliced.files for spliced, _ in result] for result in results]
    assert files[0] == files[1] != files[2]
    assert {file.parent.name for file in results[0][0][0].files} == {"noon_00", "noon_01"}


@pytest.mark.parametrize(("name", "group"), [("noon_00", "noon"), ("late_noon_3", "late_noon"), ("noon", "noon"), ("_0", "_0")])
def test_groups_are_names_up_to_the_last_underscore(name: str, group: str) -> None:
    assert group_of(name) == group


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera": PanoramaCamera(elevation_deg=(-40.0, 25.0))}, "another camera"),
        ({"image_size": (90, 20)}, "another camera"),
        ({"odometry": None}, "odometry"),
        ({"groundtruth": None}, "ground truth"),
    ],
)
def test_sequences_that_do_not_agree_are_refused_in_one_line(changes: dict, words: str) -> None:
    sequences = [a_sequence("noon_00", 10), replace(a_sequence("noon_01", 10, 1), **changes)]
    with pytest.raises(DatasetError, match=words) as caught:
        splice(sequences, 5, np.random.default_rng(0))
    assert len(caught.value.faults) == 1

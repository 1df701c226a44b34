"""Mending of poses on the small room, whose references' poses are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.map import mending
from panoloc_mcl.robot.map.keyframes import Edges, Keyframes
from panoloc_mcl.robot.map.mended import Mended
from panoloc_mcl.robot.map.mending import mend, robot_edges
from panoloc_mcl.robot.map.pairs import PairMeasurements, neighbour_pairs
from panoloc_mcl.robot.map.pose_graph import closure_error
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset

QUICK = VotesSettings()


def mended(dataset: Dataset, poses: np.ndarray, **settings: object) -> Mended:
    return mend(replace(dataset.references, poses=poses), QUICK, MapSettings(file=None, **settings))


def aligned_errors(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    a, b = found[:, :2] - found[:, :2].mean(axis=0), truth[:, :2] - truth[:, :2].mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    return np.hypot(*(a @ (u @ np.diag([1.0, np.sign(np.linalg.det(u @ v))]) @ v) - b).T)


def test_measurements_between_panoramas_become_relative_poses_of_the_robot():
    rng = np.random.default_rng(0)
    robots = np.column_stack([rng.uniform(-3, 3, (6, 2)), rng.uniform(-3, 3, 6)])
    thought = robots[:, 2] + rng.normal(0.0, 0.1, 6)
    panoramas = np.column_stack([robots[:, :2], wrap_angle(robots[:, 2] - thought)])
    pairs = neighbour_pairs(robots[:, :2], 3, 10.0)
    relative = between(panoramas[pairs[:, 0]], panoramas[pairs[:, 1]])
    covariances = np.broadcast_to(np.diag([4e-4, 1e-4, 1e-6]), (len(pairs), 3, 3))
    edges = robot_edges(PairMeasurements(pairs, relative, covariances, np.ones(len(pairs))), thought, 0.5)
    np.testing.assert_allclose(edges.measured, between(robots[edges.first], robots[edges.second]), atol=1e-9)
    # The long axis of the ellipse lies along x of the source's panorama.
    for first, covariance in zip(edges.first, edges.covariances, strict=True):
        long = np.linalg.eigh(covariance[:2, :2])[1][:, 1]
        there = compose([0.0, 0.0, -thought[first]], [1.0, 0.0, 0.0])[:2]
        assert abs(float(long @ there)) == pytest.approx(1.0, abs=1e-6)


def test_exact_poses_stay_as_they_are(small_room: Dataset):
    truth = small_room.references.poses
    result = mended(small_room, truth)
    np.testing.assert_array_equal(result.source.poses, truth)
    assert result.notes == ()
    assert len(result.keyframes.edges) > 2 * len(truth)
    # They are the frame.
    assert not result.keyframes.sds.any()


@pytest.mark.slow
def test_disturbed_poses_are_mended(small_room: Dataset):
    rng = np.random.default_rng(0)
    truth = small_room.references.poses
    given = truth + rng.standard_normal(truth.shape) * [0.05, 0.05, np.radians(2.0)]
    result = mended(small_room, given)
    before, after = aligned_errors(given, truth), aligned_errors(result.source.poses, truth)
    assert np.median(after) < 0.4 * np.median(before)
    assert np.median(np.abs(wrap_angle(result.source.poses[:, 2] - truth[:, 2] - np.mean(given[:, 2])))) < np.radians(1.0)
    assert "corrected by the images" in result.notes[0]


@pytest.mark.slow
def test_a_map_of_dead_reckoning_keeps_to_where_the_survey_began(small_room: Dataset) -> None:
    truth = small_room.references.poses
    steps = between(truth[:-1], truth[1:])
    steps[:, 2] += 0.05 * np.random.default_rng(1).standard_normal(len(steps))
    given = truth[:1]
    for step in steps:
        given = np.vstack([given, compose(given[-1], step)])
    result = mended(small_room, given)
    assert any("dead reckoning" in note for note in result.notes)
    off = result.source.poses - truth
    sds = result.keyframes.sds
    assert np.hypot(*off[:, :2].T).mean() < 0.4 * np.hypot(*(given - truth)[:, :2].T).mean()
    assert (np.abs(off[:, 2]) < 3.0 * sds[:, 1]).all()
    assert (np.hypot(*off[:, :2].T) < 3.0 * sds[:, 0] * np.sqrt(2.0)).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("said_m", "closures", "is_mended"),
    [
        (None, (0.05, 0.05), True),
        # Depths are swept from given poses: how far a survey is off excuses triangles that miss by as much, at first.
        (0.1, (0.14, 0.03), True),
        # Where it does not say so, the graph estimates it: 8 cm.
        (None, (0.14, 0.03), True),
        (None, (0.14, 0.12), False),
        (None, (0.5, 0.03), False),
        (0.1, (0.14, 0.12), False),
        (0.01, (0.14, 0.03), False),
        (0.1, (0.5, 0.03), False),
    ],
)
def test_errors_of_a_survey_excuse_triangles_in_the_first_round(
    small_room: Dataset, monkeypatch: pytest.MonkeyPatch, said_m: float | None, closures: tuple[float, ...], is_mended: bool
) -> None:
    given = small_room.references.poses + np.random.default_rng(3).standard_normal(small_room.references.poses.shape) * [
        0.08,
        0.08,
        0.03,
    ]
    found = iter(closures)
    last = closures[-1]
    monkeypatch.setattr(mending, "closure_error", lambda edges: next(found, last))
    result = mended(small_room, given, sd_xy_m=said_m, sd_theta_deg=None if said_m is None else 2.0)
    assert np.array_equal(result.source.poses, given) is not is_mended
    assert any("does not close round triangles" in note for note in result.notes) is not is_mended


@pytest.mark.slow
def test_swapped_rows_are_named_and_placed_anew_or_left_out(small_room: Dataset):
    truth = small_room.references.poses
    given = truth.copy()
    given[[0, 6]] = given[[6, 0]]
    result = mended(small_room, given)
    names = [file.name for file in small_room.references.files]
    said = "\n".join(result.notes)
    for index in (0, 6):
        assert names[index] in said
        if names[index] in result.keyframes.names:
            place = result.keyframes.names.index(names[index])
            assert np.hypot(*(result.source.poses[place] - truth[index])[:2]) < 0.1


@pytest.mark.slow
def test_a_way_that_was_driven_twice_is_searched_no_finer_than_one_driven_once(small_room: Dataset, tmp_path: Path):
    # The nearest reference is millimetres off everywhere: a grid as fine as that would not fit into any memory.
    references = small_room.references
    again = [tmp_path / f"again_{file.name}" for file in references.files]
    for copy, file in zip(again, references.files, strict=True):
        copy.write_bytes(file.read_bytes())
    truth = np.concatenate([references.poses, references.poses + np.array([0.002, 0.001, 0.0])])
    given = truth.copy()
    given[0, :2] += [1.2, 0.9]
    result = mend(replace(references, files=(*references.files, *again), poses=given), QUICK, MapSettings(file=None))
    assert references.files[0].name in "\n".join(result.notes)
    if references.files[0].name in result.keyframes.names:
        place = result.keyframes.names.index(references.files[0].name)
        assert np.hypot(*(result.source.poses[place] - truth[0])[:2]) < 0.1


def test_mending_can_be_switched_off(small_room: Dataset):
    given = small_room.references.poses + np.array([0.03, 0.0, 0.0])
    result = mended(small_room, given, mend=False)
    np.testing.assert_array_equal(result.source.poses, given)
    assert len(result.keyframes.edges) == 0


def test_keyframes_are_kept_as_they_are():
    rng = np.random.default_rng(0)
    keyframes = Keyframes.surveyed(("a", "b", "c"), rng.standard_normal((3, 3)), np.full((3, 2), 0.1))
    kept = Keyframes.restored(keyframes.names, keyframes.arrays(), keyframes.header())
    np.testing.assert_array_equal(kept.poses, keyframes.poses)
    np.testing.assert_allclose(kept.sds, 0.1)
    with pytest.raises(ValueError, match="poses"):
        Keyframes.restored(("a", "b"), keyframes.arrays() | {"given": keyframes.given[:2]}, keyframes.header())


def test_relative_poses_that_do_not_close_are_known_by_their_triangles() -> None:
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(0.0, 3.0, (8, 2)), rng.uniform(-np.pi, np.pi, 8)])
    pairs = np.array([(i, j) for i in range(8) for j in range(i + 1, 8)])
    exact = np.array([between(poses[i], poses[j]) for i, j in pairs])

    def edges(measured: np.ndarray) -> Edges:
        ones = np.ones(len(pairs))
        return replace(Edges.none(), first=pairs[:, 0], second=pairs[:, 1], measured=measured, weights=ones)

    assert closure_error(edges(exact)) == pytest.approx(0.0, abs=1e-9)
    assert closure_error(edges(exact + rng.normal(0.0, 0.01, exact.shape) * [1.0, 1.0, 0.0])) < 0.05
    assert closure_error(edges(exact + rng.normal(0.0, 0.5, exact.shape) * [1.0, 1.0, 0.0])) > 0.1
    assert closure_error(Edges.none()) == 0.0

"""How long a metre is: by the images, and by the survey."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.map.keyframes import Edges
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.map.survey_scale import SurveyScale
from panoloc_mcl.tools.datasets import Dataset

GRID = np.array([(x, y, 0.1 * x) for x in range(7) for y in range(6)], dtype=np.float64)


@given(st.floats(0.5, 2.0), st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.integers(0, 99))
@settings(max_examples=100, deadline=None)
def test_it_is_found_whatever_the_frame(ratio: float, turn: float, moved: float, seed: int) -> None:
    stretched = GRID * [ratio, ratio, 1.0]
    rng = np.random.default_rng(seed)
    survey = GRID + rng.normal(0.0, 0.02, GRID.shape)
    found = SurveyScale.of(compose(np.array([moved, -moved, turn]), stretched), survey, np.ones(len(GRID)))
    assert abs(found.ratio - ratio) < 6.0 * found.sd
    assert found.sd < 0.01 * ratio


def test_errors_of_the_survey_are_no_scale() -> None:
    rng = np.random.default_rng(1)
    ratios = [SurveyScale.of(GRID, GRID + rng.normal(0.0, 0.1, GRID.shape), np.ones(len(GRID))) for _ in range(200)]
    assert abs(np.mean([found.ratio for found in ratios]) - 1.0) < 2e-3
    assert 0.8 < np.std([found.ratio for found in ratios]) / np.mean([found.sd for found in ratios]) < 1.25
    assert not any(found.is_off for found in ratios)


@pytest.mark.parametrize("share", [0.01, 0.02, 0.05])
def test_a_survey_that_drifts_to_one_side_has_no_other_metre(share: float) -> None:
    # To and fro, row by row: the way from the first to a row grows evenly across the rows, as if the survey were stretched there.
    rows = np.array([(x if y % 2 == 0 else 6.0 - x, y, 0.0) for y in range(6) for x in range(7)])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, :2], axis=0).T))])
    for side in np.linspace(-np.pi, np.pi, 24, endpoint=False):
        survey = rows + share * way[:, None] * [np.cos(side), np.sin(side), 0.0]
        assert not SurveyScale.of(rows, survey, np.ones(len(rows))).is_off


def test_a_wrong_metre_of_a_poor_survey_is_seen() -> None:
    rng = np.random.default_rng(2)
    found = [SurveyScale.of(1.1 * GRID, GRID + rng.normal(0.0, 0.02, GRID.shape), np.ones(len(GRID))) for _ in range(100)]
    assert all(one.is_off for one in found)


def test_one_that_is_far_off_does_not_count_without_weight() -> None:
    survey, weights = GRID.copy(), np.ones(len(GRID))
    survey[3, 0] += 20.0
    weights[3] = 0.0
    assert SurveyScale.of(1.1 * GRID, survey, weights).ratio == pytest.approx(1.1)


def test_too_few_say_nothing() -> None:
    for count in (0, 1, 3):
        assert not SurveyScale.of(2.0 * GRID[:count], GRID[:count], np.ones(count)).is_off
    assert not SurveyScale.of(np.zeros((9, 3)), np.zeros((9, 3)), np.ones(9)).is_off


def test_relative_poses_are_brought_to_the_metres_of_the_survey() -> None:
    edges = Edges.of(np.array([[0, 1]]), np.array([[1.1, 2.2, 0.5]]), np.eye(3)[None])
    np.testing.assert_allclose(SurveyScale(1.1, 0.01).of_survey(edges).measured, [[1.0, 2.0, 0.5]])


@given(st.floats(0.9, 1.1), st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_given_poses_do_not_hold_relative_ones_back_from_their_metres(ratio: float, seed: int) -> None:
    # A corridor: few ways round, so that a graph with the given poses in it keeps much of their metres.
    corridor = np.array([(float(x), float(y), 0.05 * x) for x in range(20) for y in range(2)])
    pairs = np.array([(i, j) for i in range(40) for j in range(i + 1, 40) if np.hypot(*(corridor[i] - corridor[j])[:2]) < 1.1])
    noise = np.random.default_rng(seed).standard_normal((len(pairs), 3)) * [0.003, 0.003, 0.0005]
    measured = between(corridor[pairs[:, 0]], corridor[pairs[:, 1]]) * [ratio, ratio, 1.0] + noise
    edges = Edges.of(pairs, measured, np.broadcast_to(np.diag([1e-5, 1e-5, 2.5e-7]), (len(pairs), 3, 3)))
    found = SurveyScale.of_edges(edges, corridor, corridor, np.ones(len(corridor)))
    assert found.ratio == pytest.approx(ratio, abs=0.004)
    held_back = SurveyScale.of(solve(corridor, edges, Priors(corridor, np.full((40, 2), 0.01))).poses, corridor, np.ones(40))
    assert abs(held_back.ratio - 1.0) < 0.8 * abs(found.ratio - 1.0) + 0.004


@pytest.mark.slow
def test_a_wrong_height_does_not_stretch_exact_poses(small_room: Dataset) -> None:
    camera = small_room.references.camera
    assert camera.height_m is not None
    higher = replace(small_room.references, camera=camera.model_copy(update={"height_m": 1.1 * camera.height_m}))
    built = PanoramaMap.build(replace(small_room, references=higher))
    assert np.median(built.keyframes.moved_m) < 0.02
    assert any("camera.height_m" in note and "% longer" in note for note in built.notes)
    right = PanoramaMap.build(small_room)
    assert not any("camera.height_m" in note for note in right.notes)

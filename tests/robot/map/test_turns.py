"""Headings of neighbours: of the small room, and of made-up scores."""

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.map.turns import PairScores, likeliest_headings, pair_scores, refined
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import read_dataset

EVERYWHERE = np.inf


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory):
    """Two references of the room, 0.6 m apart, turned to their true headings."""
    path = tmp_path_factory.mktemp("pair") / "data"
    build_room(
        path, frames=1, geometry=PanoramaGeometry(72, 36, -50.0, 25.0), grid=((0.6, 0.9), (1.1, 1.233)), lights=("noon",)
    )
    return read_references(read_dataset(path).references)


@pytest.mark.parametrize("threads", [1, 2])
def test_both_headings_of_a_pair_are_found(pair, threads: int) -> None:
    scores = pair_scores(pair, np.array([[0, 1]]), VotesSettings(), np.full(2, EVERYWHERE), threads=threads)
    first, second = np.unravel_index(scores.table(0).argmax(), (72, 72))
    # In columns of 5 degrees; directions are tried every 15 degrees.
    assert abs(first) <= 3 or abs(first) >= 69
    turn = (int(second) - int(first)) % 72
    assert turn in (71, 0, 1)


def test_headings_that_are_not_likely_are_not_tried(pair) -> None:
    # The heading of the first is known to 11 degrees.
    scores = pair_scores(pair, np.array([[0, 1]]), VotesSettings(), np.radians([11.0, EVERYWHERE]))
    at = 2.0 * np.pi * np.arange(24) / 24
    # Within three standard deviations and one step.
    far = np.abs(wrap_angle(at)) > np.radians(48.0)
    assert np.isinf(scores.forth[0, far]).all()
    assert np.isfinite(scores.forth[0, ~far]).all()
    assert np.isfinite(scores.back).all()
    # Whatever the first shows, its heading is found where it is likely.
    first, _ = np.unravel_index(scores.table(0).argmax(), (72, 72))
    assert first <= 9 or first >= 63


def made_up(truth: np.ndarray, pairs: np.ndarray, wrong: np.ndarray, rng: np.random.Generator, columns: int = 60) -> PairScores:
    """A ridge along the true turn of each pair, highest at the true headings; of wrong ones a lower ridge, elsewhere."""
    every = 2.0 * np.pi * np.arange(columns) / columns
    directions = 2.0 * np.pi * np.arange(24) / 24

    def scores(first: int, second: int, off: float, height: float) -> np.ndarray:
        ridge = height * np.exp(-0.5 * np.square(wrap_angle(every - (truth[second] - truth[first]) - off) / np.radians(8.0)))
        hill = 0.8 + 0.2 * np.cos(directions - truth[first])
        return (ridge[None, :] * hill[:, None] + rng.normal(0.0, 1.0, (24, columns))).astype(np.float32)

    forth, back = [], []
    for (first, second), is_wrong in zip(pairs.tolist(), wrong, strict=True):
        off, height = (rng.uniform(0.5, 5.5), 4.0) if is_wrong else (0.0, 40.0)
        forth.append(scores(first, second, off, height))
        back.append(scores(second, first, -off, height))
    return PairScores(pairs, np.array(forth), np.array(back))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_headings_explain_all_pairs_though_some_are_wrong(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-np.pi, np.pi, 20)
    pairs = np.array([(i, j) for i in range(20) for j in range(i + 1, min(i + 4, 20))])
    wrong = rng.random(len(pairs)) < 0.25
    # A chain of right ones joins all.
    wrong[pairs[:, 1] == pairs[:, 0] + 1] = False
    found, residual = likeliest_headings(made_up(truth, pairs, wrong, rng), np.full(20, EVERYWHERE))
    # How all are turned together is told but roughly by columns; `by_common_turn` is for that.
    assert np.abs(angle_difference(found, truth)).max() < np.radians(50.0)
    assert np.abs(angle_difference(found - found[0], truth - truth[0])).max() < np.radians(2.0)
    assert residual < np.radians(1.0)


def test_given_headings_outweigh_what_images_say_of_directions() -> None:
    rng = np.random.default_rng(4)
    truth = np.radians(np.array([10.0, -20.0, 15.0, 0.0]))
    pairs = np.array([[0, 1], [1, 2], [2, 3]])
    scores = made_up(truth, pairs, np.zeros(3, dtype=bool), rng)
    # The truth is that of a frame turned by 30 degrees: the given headings, sure to a degree, are kept.
    sds = np.array([np.radians(1.0), EVERYWHERE, EVERYWHERE, EVERYWHERE])
    found, _ = likeliest_headings(scores, sds)
    assert abs(found[0]) < np.radians(2.0)
    assert np.degrees(wrap_angle(found - found[0])) == pytest.approx(np.degrees(truth - truth[0]), abs=1.5)


def test_a_common_turn_is_where_all_pairs_fit_best() -> None:
    rng = np.random.default_rng(6)
    truth = rng.uniform(-np.pi, np.pi, 8)
    pairs = np.array([(i, j) for i in range(8) for j in range(i + 1, min(i + 3, 8))])
    scores = made_up(truth, pairs, np.zeros(len(pairs), dtype=bool), rng)
    turns = np.radians(np.arange(0.0, 360.0, 2.0))
    # Headings whose turns are right, but which are all turned by 50 degrees.
    by_turn = scores.by_common_turn(truth - np.radians(50.0), turns)
    assert by_turn.shape == (len(pairs), 180)
    assert np.degrees(turns[by_turn.sum(axis=0).argmax()]) == pytest.approx(50.0, abs=4.0)
    # At a direction and a turn that were tried, it is what was measured.
    headings = np.zeros(8)
    measured = scores.forth[0, 0, 0] + scores.back[0, 0, 0]
    assert scores.by_common_turn(headings, np.zeros(1))[0, 0] == pytest.approx(measured, abs=1e-3)


def test_without_pairs_nothing_is_corrected() -> None:
    nothing = PairScores(np.zeros((0, 2), dtype=np.int64), *np.zeros((2, 0, 24, 60), dtype=np.float32))
    found, _ = likeliest_headings(nothing, np.full(3, EVERYWHERE))
    np.testing.assert_array_equal(found, np.zeros(3))


def test_outlying_turns_are_outvoted() -> None:
    rng = np.random.default_rng(2)
    truth = wrap_angle(rng.uniform(-np.pi, np.pi, 30))
    pairs = np.array([(i, j) for i in range(30) for j in range(i + 1, min(i + 5, 30))])
    turns = wrap_angle(truth[pairs[:, 1]] - truth[pairs[:, 0]] + rng.normal(0.0, 0.01, len(pairs)))
    wrong = rng.random(len(pairs)) < 0.2
    turns[wrong] = rng.uniform(-np.pi, np.pi, wrong.sum())
    start = truth + rng.normal(0.0, 0.1, 30)
    found, residual = refined(pairs, turns, np.ones(len(pairs)), start, np.full(30, np.inf))
    assert np.abs(angle_difference(found - found[0], truth - truth[0])).max() < 0.05
    # Turns say nothing of all headings together: their mean stays.
    assert angle_difference(found, start).mean() == pytest.approx(0.0, abs=1e-3)
    assert residual < 0.03

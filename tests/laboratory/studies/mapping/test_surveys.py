"""Errors of surveys: how large they are, and that those called wrong are the ones that are."""

import numpy as np
import pytest

from panoloc_mcl.laboratory.studies.mapping.surveys import SURVEYS, disturbed
from panoloc_mcl.robot.geometry import angle_difference

X, Y = np.meshgrid(np.arange(7.0), np.arange(6.0))
POSES = np.column_stack([X.ravel(), Y.ravel(), np.zeros(42)])


def off(kind: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray, list[int]]:
    moved, wrong = disturbed(kind, POSES, seed)
    return np.hypot(*(moved - POSES)[:, :2].T), np.abs(angle_difference(moved[:, 2], POSES[:, 2])), wrong


@pytest.mark.parametrize(("kind", "metres", "degrees"), [("exact", 0.0, 0.0), ("2cm", 0.02, 1.0), ("10cm", 0.1, 3.0)])
def test_small_errors_are_as_large_as_they_are_called(kind: str, metres: float, degrees: float) -> None:
    away, turned, wrong = off(kind)
    assert wrong == []
    assert np.sqrt(np.mean(away**2) / 2.0) == pytest.approx(metres, rel=0.2)
    assert np.degrees(np.sqrt(np.mean(turned**2))) == pytest.approx(degrees, rel=0.3)


def test_a_drift_grows_with_the_way_to_and_fro() -> None:
    away, turned, _ = off("drift")
    assert not turned.any()
    # Six rows of six metres, and five steps between them.
    assert away.max() == pytest.approx(0.02 * 41.0)
    assert away[0] == 0.0
    assert away[7] == pytest.approx(0.02 * 13.0)
    assert away[13] == pytest.approx(0.02 * 7.0)


@pytest.mark.parametrize("seed", range(5))
def test_gross_errors_are_two_swapped_one_shifted_and_one_turned(seed: int) -> None:
    away, turned, wrong = off("gross", seed)
    touched = np.flatnonzero((away > 1e-9) | (turned > 1e-9))
    assert touched.tolist() == wrong
    assert len(wrong) == 4
    assert np.sum(np.degrees(turned) > 20.0) == 1
    assert np.sum(np.isclose(away, 1.0)) >= 1
    assert (away[turned == 0.0][away[turned == 0.0] > 0.0] >= 1.0 - 1e-9).all()


def test_a_seed_gives_the_same_errors_and_another_others() -> None:
    for kind in SURVEYS:
        np.testing.assert_array_equal(disturbed(kind, POSES, 1)[0], disturbed(kind, POSES, 1)[0])
        assert kind == "exact" or not np.array_equal(disturbed(kind, POSES, 1)[0], disturbed(kind, POSES, 2)[0])

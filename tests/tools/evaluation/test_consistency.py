from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.tools.evaluation import consistency, evaluate

COVARIANCE = np.array([[4e-6, 1e-6, 0.0], [1e-6, 2e-6, 1e-7], [0.0, 1e-7, 1e-6]])


def drawn(count: int, scale: float = 1.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Errors that are normal with a covariance, and so many times as large as is claimed."""
    errors = np.random.default_rng(seed).multivariate_normal(np.zeros(3), COVARIANCE, count)
    return scale * errors, np.tile(COVARIANCE, (count, 1, 1))


def test_errors_as_large_as_claimed_are_consistent() -> None:
    held = consistency(*drawn(100_000))
    assert held["position"]["nees_median"] == pytest.approx(1.0, abs=0.02)
    assert held["heading"]["nees_median"] == pytest.approx(1.0, abs=0.02)
    for count, position, heading in ((1, 0.393, 0.683), (2, 0.865, 0.954), (3, 0.989, 0.997)):
        assert held["position"][f"inside_{count}sd"] == pytest.approx(position, abs=0.006)
        assert held["heading"][f"inside_{count}sd"] == pytest.approx(heading, abs=0.006)


@given(scale=st.floats(0.1, 10.0), turn=st.floats(-3.0, 3.0))
@settings(max_examples=30, deadline=None)
def test_nees_grows_with_the_square_and_does_not_depend_on_the_axes(scale: float, turn: float) -> None:
    errors, covariances = drawn(200)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    plain = consistency(errors, covariances)
    other = consistency(scale * errors @ rotation.T, rotation @ covariances @ rotation.T)
    for axis in ("position", "heading"):
        assert other[axis]["nees_median"] == pytest.approx(scale**2 * plain[axis]["nees_median"], rel=1e-6)


def test_rows_that_claim_nothing_are_left_out() -> None:
    errors, covariances = drawn(50)
    whole = consistency(errors, covariances)
    bad = np.stack([np.full((3, 3), np.nan), np.zeros((3, 3)), -np.eye(3)])
    assert consistency(np.vstack([errors, np.ones((3, 3))]), np.concatenate([covariances, bad])) == whole


def test_nothing_claimed_is_no_figure() -> None:
    empty = consistency(np.zeros((0, 3)), np.zeros((0, 3, 3)))
    assert set(empty["position"].values()) == set(empty["heading"].values()) == {None}


def test_metrics_hold_converged_frames_against_their_claims(make_record) -> None:
    record = make_record("sccc", metres=[5.0, 0.001, 0.0018, 0.01], degrees=[0.0, 0.005, -0.009, 0.035])
    assert evaluate([record], None)["overall"]["consistency"]["position"]["nees_median"] is None
    claimed = replace(record, covariances=np.tile(np.diag([0.002, 0.002, np.radians(0.01)]) ** 2, (4, 1, 1)))
    held = evaluate([claimed], None)["overall"]["consistency"]
    assert held["position"]["inside_1sd"] == pytest.approx(2 / 3)
    assert held["position"]["nees_median"] == pytest.approx(0.81 / (2.0 * np.log(2.0)))
    assert held["heading"]["inside_3sd"] == pytest.approx(2 / 3)

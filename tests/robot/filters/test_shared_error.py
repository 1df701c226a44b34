import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.filters.shared_error import SharedError, kept_share
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement

COVARIANCE = np.diag([8e-4, 8e-4, 3e-4]) ** 2


def fused(shared: SharedError, cluster: Cluster, measured: np.ndarray, covariance: np.ndarray, kept: float):
    """Mean and covariance of belief and image together."""
    seen = shared.seen(cluster, measured, covariance, np.full(3, kept))
    told, said = np.linalg.inv(cluster.covariance + seen.widening), np.linalg.inv(seen.covariance)
    after = np.linalg.inv(told + said)
    return cluster.pose + after @ said @ (measured - cluster.pose), after, seen


def test_no_belief_leaves_the_way_between_prediction_and_image() -> None:
    # After 30 cm along one direction with an uncertain last turn, as odometry of the rendered hall gives it: the predicted covariance
    # is nearly singular across the way.
    xy, x_heading, y_heading = 3.037e-5, 1.859e-6, 3.993e-6
    predicted = np.array([[1.1712e-5, xy, x_heading], [xy, 8.2988e-5, y_heading], [x_heading, y_heading, 2.3822e-3]])
    shared = SharedError(np.array([-0.00887, 5.00439, -1.92192]), COVARIANCE)
    cluster = Cluster(np.array([-0.008644, 5.001537, -1.419903]), predicted, 1.0)
    measured = np.array([-0.009870, 5.004471, -1.399249])
    mean, after, _ = fused(shared, cluster, measured, COVARIANCE, 0.976)
    for inverse in (np.linalg.inv(COVARIANCE), np.linalg.inv(predicted + 1e-9 * np.eye(3))):
        off = mean - measured
        assert min(off @ inverse @ off, (mean - cluster.pose) @ inverse @ (mean - cluster.pose)) < 16.3
    assert np.hypot(*(mean - measured)[:2]) <= 1.05 * np.hypot(*(cluster.pose - measured)[:2])
    assert np.linalg.eigvalsh(after).min() > 0.0


def test_standing_still_teaches_next_to_nothing() -> None:
    shared = SharedError(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.zeros(3), COVARIANCE, 1.0)
    rng = np.random.default_rng(0)
    for _ in range(100):
        _, _, seen = fused(shared, cluster, 1e-4 * rng.standard_normal(3), COVARIANCE, 1.0)
        assert not seen.new
        shared = seen.shared


def test_standing_still_no_belief_becomes_surer_than_one_look() -> None:
    # Wider than the image by ever less, in position and in heading; and surer than it in one direction.
    for wider in ([100.0, 100.0, 100.0], [1.5, 1.5, 1.5], [1.2, 1.2, 1.0], [0.5, 1.3, 20.0], [0.9, 1.05, 1.0]):
        predicted = COVARIANCE * np.array(wider)
        shared, cluster = SharedError(np.zeros(3), 0.9 * COVARIANCE), Cluster(np.zeros(3), predicted, 1.0)
        for _ in range(30):
            _, after, seen = fused(shared, cluster, np.zeros(3), COVARIANCE, 1.0)
            if not seen.new:
                break
            shared, cluster = seen.shared, Cluster(np.zeros(3), after, 1.0)
        assert not seen.new
        reached = np.diag(cluster.covariance) / np.diag(COVARIANCE)
        assert np.all(reached > np.minimum(wider, 1.0) - 0.05)
        assert np.all(reached < 1.3)


def test_creeping_on_errors_are_forgotten_as_on_one_long_way() -> None:
    shared, cluster = SharedError(np.zeros(3), COVARIANCE), Cluster(np.zeros(3), COVARIANCE, 1.0)
    for _ in range(100):
        seen = shared.seen(cluster, np.zeros(3), COVARIANCE, np.full(3, 0.95))
        if seen.new:
            break
        shared = seen.shared
    assert seen.new


def test_far_on_an_image_tells_all_it_would_alone() -> None:
    shared = SharedError(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.array([3.0, 0.0, 0.0]), np.diag([0.1, 0.1, 0.05]) ** 2, 1.0)
    seen = shared.seen(cluster, np.array([3.02, 0.01, 0.01]), COVARIANCE, np.zeros(3))
    np.testing.assert_allclose(seen.covariance, COVARIANCE, rtol=0.05, atol=1e-10)
    assert seen.new


def test_a_wide_belief_takes_the_image_as_it_is_however_near_the_last_one() -> None:
    shared = SharedError(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.zeros(3), np.diag([0.05, 0.05, 0.02]) ** 2, 1.0)
    _, after, seen = fused(shared, cluster, np.array([0.01, 0.0, 0.0]), COVARIANCE, 0.999)
    np.testing.assert_allclose(np.diag(after), np.diag(COVARIANCE), rtol=0.1)
    assert seen.new


@given(seed=st.integers(0, 10_000), kept=st.floats(0.0, 0.999), share=st.floats(0.0, 1.0), correlation=st.floats(-1.0, 1.0))
@settings(max_examples=200, deadline=None)
def test_what_is_claimed_holds_however_the_shared_parts_are_correlated(
    seed: int, kept: float, share: float, correlation: float
) -> None:
    """The true covariance of the fused mean is no larger than claimed, in any direction, but for what is nearly nothing."""
    rng = np.random.default_rng(seed)
    scales = np.array([1e-3, 1e-3, 4e-4])
    belief, image = (_some_covariance(rng, scales * rng.uniform(0.5, 5.0)) for _ in range(2))
    theirs = share * belief
    cluster = Cluster(np.zeros(3), belief, 1.0)
    shared = SharedError(np.zeros(3), theirs + 1e-12 * np.eye(3))
    seen = shared.seen(cluster, np.zeros(3), image, np.full(3, kept))
    if not seen.new:
        return
    told, said = np.linalg.inv(belief + seen.widening), np.linalg.inv(seen.covariance)
    after = np.linalg.inv(told + said)
    gain, rest = after @ said, after @ told
    # Shared parts that are correlated by so much, with whatever directions they have.
    theirs, ours = kept**2 * theirs, 0.98 * image
    cross = (
        correlation
        * np.linalg.cholesky(theirs + 1e-15 * np.eye(3))
        @ _rotation(rng)
        @ np.linalg.cholesky(ours + 1e-15 * np.eye(3)).T
    )
    true = rest @ belief @ rest.T + gain @ image @ gain.T + rest @ cross @ gain.T + gain @ cross.T @ rest.T
    worst = float(np.linalg.eigvals(np.linalg.solve(after, true)).real.max())
    assert worst < 1.01


def _some_covariance(rng: np.random.Generator, sds: np.ndarray) -> np.ndarray:
    root = _rotation(rng) * rng.uniform(0.3, 1.0, 3)
    return np.outer(sds, sds) * (root @ root.T)


def _rotation(rng: np.random.Generator) -> np.ndarray:
    return np.linalg.qr(rng.standard_normal((3, 3)))[0]


@pytest.mark.parametrize("way", [0.0, 0.1, 1.0, 100.0])
def test_what_a_map_errs_by_as_a_whole_is_shared_by_all_images(way: float) -> None:
    frame = np.diag([9e-5, 9e-5, 0.0])
    view = COVARIANCE
    kept = kept_share(
        PoseMeasurement(np.zeros(3), frame + view, np.zeros(2), Agreement(0.9, np.ones(24), 0.9), of_frame=frame), way, 1.0
    )
    assert np.all(kept[:2] >= 9e-5 / (9e-5 + view[0, 0]))
    assert np.all(kept <= 1.0)
    alone = kept_share(PoseMeasurement(np.zeros(3), view, np.zeros(2), Agreement(0.9, np.ones(24), 0.9)), way, 1.0)
    assert np.all(alone <= kept)
    # Headings err alike for longer than positions.
    assert alone[2] >= alone[0]
    assert way > 0.0 or np.all(alone == 1.0)

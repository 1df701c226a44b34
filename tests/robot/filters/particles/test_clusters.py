import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters.particles import clusters as of_particles
from panoloc_mcl.robot.geometry import angle_difference


def find_clusters(poses: np.ndarray, weights: np.ndarray, most: int = 5) -> tuple:
    return of_particles.find_clusters(CompactPoses.of(poses, (0.0, 0.0)), weights.astype(np.float32), most)


def blob(rng: np.random.Generator, centre, count: int = 300, sd_m: float = 0.1, sd_deg: float = 3.0) -> np.ndarray:
    return np.asarray(centre) + rng.normal(size=(count, 3)) * [sd_m, sd_m, np.radians(sd_deg)]


def evenly(poses: np.ndarray) -> np.ndarray:
    return np.full(len(poses), 1.0 / len(poses))


def test_two_blobs_are_two_clusters_with_their_own_means() -> None:
    rng = np.random.default_rng(0)
    poses = np.vstack([blob(rng, (0.0, 0.0, 0.5), 200), blob(rng, (3.0, 1.0, -2.0), 600)])
    first, second = find_clusters(poses, evenly(poses))[:2]
    assert first.pose == pytest.approx([3.0, 1.0, -2.0], abs=0.03)
    assert second.pose == pytest.approx([0.0, 0.0, 0.5], abs=0.03)
    assert first.mass == pytest.approx(0.75, abs=0.02)
    assert second.mass == pytest.approx(0.25, abs=0.02)
    assert first.spread_m == pytest.approx(0.1, rel=0.2)
    assert first.spread_deg == pytest.approx(3.0, rel=0.2)


def test_the_same_place_with_another_heading_is_another_cluster() -> None:
    rng = np.random.default_rng(1)
    poses = np.vstack([blob(rng, (1.0, 1.0, 0.0)), blob(rng, (1.0, 1.0, 2.0))])
    assert [round(cluster.mass, 1) for cluster in find_clusters(poses, evenly(poses))] == [0.5, 0.5]


@pytest.mark.parametrize("heading", [np.pi, -np.pi, 3.1, -3.1])
def test_a_cluster_at_the_seam_is_one(heading: float) -> None:
    poses = blob(np.random.default_rng(2), (0.0, 0.0, heading))
    poses[:, 2] = angle_difference(poses[:, 2], 0.0)
    (cluster, *rest) = find_clusters(poses, evenly(poses))
    assert cluster.mass > 0.98
    assert sum(other.mass for other in rest) < 0.02
    assert abs(float(angle_difference(cluster.pose[2], heading))) < np.radians(1.0)
    assert cluster.spread_deg == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize("dx", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("dy", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("heading", [np.pi - 0.1, -np.pi + 0.1])
def test_touching_cells_on_both_sides_of_the_seam_belong_together(dx: int, dy: int, heading: float) -> None:
    # Centres of cells of 0.4 m; the headings are 0.2 rad apart, over the seam.
    pair = np.array([[0.2, 0.2, heading], [0.2 + 0.4 * dx, 0.2 + 0.4 * dy, -heading]])
    assert len(find_clusters(pair, evenly(pair))) == (1 if max(abs(dx), abs(dy)) < 2 else 2)


def test_a_chain_of_like_particles_is_one_cluster() -> None:
    ring = np.linspace(-np.pi, np.pi, 200, endpoint=False)
    for chain in (
        np.column_stack([np.linspace(0.0, 8.0, 200), np.linspace(0.0, -5.0, 200), np.zeros(200)]),
        np.column_stack([np.zeros((200, 2)), ring]),
    ):
        (cluster,) = find_clusters(chain, evenly(chain))
        assert cluster.mass == pytest.approx(1.0)


@pytest.mark.parametrize("count", [10, 1000, 30_000])
def test_stray_particles_between_two_hypotheses_do_not_join_them(count: int) -> None:
    rng = np.random.default_rng(3)
    stray = rng.uniform([-1.0, -1.0, -np.pi], [5.0, 3.0, np.pi], (count, 3))
    poses = np.vstack([blob(rng, (0.0, 0.0, 0.5)), blob(rng, (4.0, 2.0, 1.0)), stray])
    weights = np.r_[np.full(600, 1.0), np.full(count, 6.0 / count)]
    clusters = find_clusters(poses, weights / weights.sum())
    assert [cluster.mass for cluster in clusters[:2]] == pytest.approx([0.5, 0.5], abs=0.03)
    assert min(np.hypot(*(clusters[0].pose[:2] - end)) for end in ((0.0, 0.0), (4.0, 2.0))) < 0.1


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 200), st.floats(0.1, 20.0), st.integers(0, 10_000))
def test_masses_are_shares_by_falling_size(count: int, size: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = rng.uniform([-size, -size, -np.pi], [size, size, np.pi], (count, 3))
    weights = rng.random(count)
    weights /= weights.sum()
    clusters = find_clusters(poses, weights, most=count)
    masses = [cluster.mass for cluster in clusters]
    assert masses == sorted(masses, reverse=True)
    assert sum(masses) == pytest.approx(1.0)
    assert [cluster.mass for cluster in find_clusters(poses, weights)] == masses[:5]
    for cluster in clusters:
        assert np.linalg.eigvalsh(cluster.covariance).min() > -1e-12


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.floats(-4.0, 4.0))
def test_turning_everything_turns_the_clusters(seed: int, turn: float) -> None:
    rng = np.random.default_rng(seed)
    poses = np.vstack([blob(rng, (0.0, 0.0, 0.0), 100, 0.05, 1.0), blob(rng, (5.0, 5.0, 2.0), 300, 0.05, 1.0)])
    after = poses.copy()
    after[:, 2] = angle_difference(after[:, 2] + turn, 0.0)
    for one, other in zip(find_clusters(poses, evenly(poses))[:2], find_clusters(after, evenly(after))[:2], strict=True):
        assert other.mass == pytest.approx(one.mass, abs=0.02)
        assert abs(float(angle_difference(other.pose[2], one.pose[2] + turn))) < 0.01


def test_a_cluster_is_the_weighted_mean_and_covariance() -> None:
    rng = np.random.default_rng(5)
    poses, weights = blob(rng, (1.0, 2.0, 0.3)), rng.random(300)
    weights /= weights.sum()
    (cluster,) = find_clusters(poses, weights)
    off = poses - cluster.pose
    assert cluster.covariance == pytest.approx((off * weights[:, None]).T @ off, abs=1e-8)
    assert cluster.covariance[:2, :2] == pytest.approx(np.cov(poses[:, :2].T, aweights=weights, ddof=0))
    assert cluster.pose[:2] == pytest.approx(np.average(poses[:, :2], axis=0, weights=weights))
    # Within a few degrees the circular mean is the plain one up to third order.
    assert cluster.pose[2] == pytest.approx(np.average(poses[:, 2], weights=weights), abs=1e-4)
    assert cluster.mass == pytest.approx(1.0)


def test_a_grid_too_large_for_a_table_is_sorted_and_gives_the_same() -> None:
    rng = np.random.default_rng(6)
    near = np.vstack([blob(rng, (0.0, 0.0, 0.5), 200), blob(rng, (3.0, 1.0, -2.0), 600)])
    far = np.vstack([near, [[5000.0, -5000.0, 0.0]]])
    weights = np.r_[evenly(near), 0.0]
    for one, other in zip(find_clusters(near, evenly(near)), find_clusters(far, weights), strict=True):
        assert one.pose == pytest.approx(other.pose, abs=1e-6)
        assert one.covariance == pytest.approx(other.covariance, abs=1e-6)
        assert one.mass == pytest.approx(other.mass)


def test_one_particle_is_a_cluster_of_no_spread() -> None:
    (cluster,) = find_clusters(np.array([[1.0, -2.0, 3.0]]), np.ones(1))
    assert cluster.pose == pytest.approx([1.0, -2.0, 3.0])
    assert cluster.spread_m == cluster.spread_deg == 0.0

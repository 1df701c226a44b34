"""Errors in common, against measurements that are made with them one by one."""

import numpy as np

from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.map.drives.common_errors import common_errors
from panoloc_mcl.robot.map.keyframes import IMAGES, ODOMETRY, Edges
from panoloc_mcl.robot.map.pose_graph import Priors, solve


def test_every_error_adds_to_the_measurements_that_share_it():
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(0.0, 3.0, (5, 2)), rng.uniform(-3.0, 3.0, 5)])
    owner = np.array([0, 0, 0, 1, 1])
    pairs = np.array([(i, j) for i in range(5) for j in range(5) if i != j])
    edges = Edges.of(pairs, between(poses[pairs[:, 0]], poses[pairs[:, 1]]), np.broadcast_to(np.eye(3), (20, 3, 3)))
    edges.kinds[::4] = ODOMETRY
    common = common_errors(edges, poses, owner)
    sizes = [rng.normal(size=size) for size in (5, 2, 5, 1, 5, 2, 2)]
    turns, of_drives, lengths, length, seen, creeping, wheels = sizes
    found = (common.effects @ np.concatenate(sizes)).reshape(-1, 3)
    assert len(common.sds) == common.effects.shape[1] == 22
    assert (common.sds > 0.0).all()
    for row, (i, j) in enumerate(pairs):
        ahead, left, _ = edges.measured[row]
        if edges.kinds[row] != IMAGES:
            stretch, turn = wheels[owner[i]], creeping[owner[i]] * np.hypot(ahead, left)
            np.testing.assert_allclose(found[row], [stretch * ahead, stretch * left, turn], atol=1e-12)
            continue
        stretch = lengths[i] + length[0]
        bend = turns[i] + of_drives[owner[i]]
        expected = [
            stretch * ahead - bend * ahead * left,
            stretch * left + 0.5 * bend * ahead**2,
            bend * ahead + seen[j] - seen[i],
        ]
        np.testing.assert_allclose(found[row], expected, atol=1e-12)


def test_a_map_does_not_shrink_to_fit_noise():
    scales = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        x, y = np.meshgrid(0.5 * np.arange(6), 0.5 * np.arange(5))
        truth = np.column_stack([x.ravel(), y.ravel(), rng.uniform(-3.0, 3.0, 30)])
        apart = np.hypot(*(truth[:, None, :2] - truth[None, :, :2]).transpose(2, 0, 1))
        pairs = np.argwhere((apart < 1.2) & (apart > 0.0))
        sd = np.array([0.03, 0.03, 0.01])
        relative = between(truth[pairs[:, 0]], truth[pairs[:, 1]]) + rng.standard_normal((len(pairs), 3)) * sd
        edges = Edges.of(pairs, relative, np.broadcast_to(np.diag(sd**2), (len(pairs), 3, 3)))
        sds = np.full((30, 2), np.inf)
        sds[0] = 1e-4
        priors = Priors(truth, sds, robust=False)
        found = solve(truth, edges, priors, common=common_errors(edges, truth, np.zeros(30, dtype=np.int64))).poses
        own, theirs = found[:, :2] - found[:, :2].mean(axis=0), truth[:, :2] - truth[:, :2].mean(axis=0)
        scales.append(np.linalg.norm(own) / np.linalg.norm(theirs))
    assert abs(np.mean(scales) - 1.0) < 0.003


def test_odometry_that_creeps_does_not_bend_a_drive_without_loops():
    """Images leave a small turn with every metre open; odometry, which turns by a degree a metre, must not fill it in."""
    count, step, turn = 50, 0.4, np.radians(1.0)
    truth = np.column_stack([step * np.arange(count), np.zeros(count), np.zeros(count)])
    rng = np.random.default_rng(0)
    pairs = np.array([(i, j) for i in range(count) for j in range(count) if 0 < abs(i - j) <= 2])
    of_images, of_wheels = np.array([0.003, 0.003, 0.0005]), np.array([0.02, 0.02, np.radians(0.4)])
    seen = between(truth[pairs[:, 0]], truth[pairs[:, 1]]) + rng.standard_normal((len(pairs), 3)) * of_images
    steps = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    driven = between(truth[:-1], truth[1:]) + [0.0, 0.0, turn * step] + rng.standard_normal((count - 1, 3)) * of_wheels
    edges = Edges.of(steps, driven, np.broadcast_to(np.diag(of_wheels**2), (count - 1, 3, 3)), ODOMETRY)
    edges = edges.joined(Edges.of(pairs, seen, np.broadcast_to(np.diag(of_images**2), (len(pairs), 3, 3))))
    sds = np.full((count, 2), np.inf)
    sds[0] = 1e-4
    found = solve(
        truth, edges, Priors(truth, sds, robust=False), common=common_errors(edges, truth, np.zeros(count, dtype=np.int64))
    )
    off = np.abs(found.poses[-1] - truth[-1])
    assert off[2] < np.radians(0.3)
    assert off[1] < 0.05


def test_a_world_that_is_bent_is_an_error_that_poses_cannot_tell():
    """Relative poses along an arc are those of a straight way in a bent world, to first order."""
    bend, step = 1e-4, 0.4
    arc = np.column_stack([step * np.arange(12), 0.5 * bend * (step * np.arange(12)) ** 2, bend * step * np.arange(12)])
    straight = np.column_stack([step * np.arange(12), np.zeros(12), np.zeros(12)])
    pairs = np.array([(i, j) for i in range(12) for j in range(12) if i != j])
    seen = between(arc[pairs[:, 0]], arc[pairs[:, 1]])
    edges = Edges.of(pairs, seen, np.broadcast_to(np.eye(3), (len(pairs), 3, 3)))
    common = common_errors(edges, straight, np.zeros(12, dtype=np.int64))
    sizes = np.zeros(common.effects.shape[1])
    sizes[12] = bend
    off = seen - between(straight[pairs[:, 0]], straight[pairs[:, 1]])
    np.testing.assert_allclose((common.effects @ sizes).reshape(-1, 3), off, atol=1e-6)


def test_drives_whose_images_say_nothing_stay_where_odometry_has_them():
    rng = np.random.default_rng(0)
    driven = np.column_stack([rng.uniform(0.2, 0.5, 9), np.zeros(9), rng.uniform(-0.5, 0.5, 9)])
    poses = [np.zeros(3)]
    for step in driven:
        poses.append(compose(poses[-1], step))
    steps = np.column_stack([np.arange(9), np.arange(1, 10)])
    edges = Edges.of(steps, driven, np.broadcast_to(np.diag([1e-4, 1e-4, 1e-4]), (9, 3, 3)), ODOMETRY)
    common = common_errors(edges, np.array(poses), np.zeros(10, dtype=np.int64))
    # Of the errors of images: of each keyframe, of the drive, of all.
    assert common.effects[:, : 10 + 1 + 10 + 1 + 10].nnz == 0
    sds = np.full((10, 2), np.inf)
    sds[0] = 1e-4
    found = solve(np.array(poses), edges, Priors(np.array(poses), sds, robust=False), common=common)
    np.testing.assert_allclose(found.poses, poses, atol=1e-6)

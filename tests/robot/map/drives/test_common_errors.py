"""Errors in common, against measurements that are made with them one by one."""

import numpy as np

from panoloc_mcl.robot.geometry import between
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
    turns, of_drives, lengths, length, seen = (rng.normal(size=size) for size in (5, 2, 5, 1, 5))
    found = (common.effects @ np.concatenate([turns, of_drives, lengths, length, seen])).reshape(-1, 3)
    assert len(common.sds) == common.effects.shape[1] == 18
    assert (common.sds > 0.0).all()
    for row, (i, j) in enumerate(pairs):
        if edges.kinds[row] != IMAGES:
            assert not found[row].any()
            continue
        ahead, left, _ = edges.measured[row]
        stretch = lengths[i] + length[0]
        turn = (turns[i] + of_drives[owner[i]]) * ahead + seen[j] - seen[i]
        np.testing.assert_allclose(found[row], [stretch * ahead, stretch * left, turn], atol=1e-12)


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


def test_drives_whose_images_say_nothing_have_no_errors_in_common():
    steps = Edges.of(np.array([[0, 1]]), np.array([[0.5, 0.0, 0.0]]), np.eye(3)[None], ODOMETRY)
    common = common_errors(steps, np.zeros((2, 3)), np.zeros(2, dtype=np.int64))
    assert common.effects.nnz == 0

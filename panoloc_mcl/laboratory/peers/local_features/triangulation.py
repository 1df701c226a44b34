"""Points of the world from references with known poses, as COLMAP triangulates them (Schoenberger & Frahm, CVPR 2016).

The way of hloc (Sarlin et al., CVPR 2019): features of neighbouring references are matched, matches that contradict the known poses are
left out, and COLMAP triangulates what is left, completes and merges tracks and adjusts points, the poses held as they are given.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.laboratory.peers.local_features.kinds import Features, Found
from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, cam_from_world, pycolmap
from panoloc_mcl.robot.progress import Progress

Float64 = NDArray[np.float64]

# Matches may lie so many pixels of the sphere off the circle that the other image's ray is seen as.
_EPIPOLAR_PX = 4.0


def triangulate(
    found: Sequence[Found],
    positions: Float64,
    sphere: Sphere,
    features: Features,
    neighbours: int,
    progress: Progress,
) -> tuple[Float64, list[NDArray[np.int64]]]:
    """Triangulate.

    Parameters
    ----------
    found : sequence of Found
        Of every reference, at heading 0.
    positions : float64 (n, 2)
        Where the references were taken, metres.
    sphere : Sphere
    features : Features
    neighbours : int
        Nearest references that each is matched with.
    progress : callable (done, total, what)

    Returns
    -------
    points : float64 (p, 3)
        Metres; z is height above the camera's.
    point_of : list of int64 (m,)
        For every reference the point that each of its features shows, -1 where none.
    """
    colmap = pycolmap()
    poses = [cam_from_world(np.array([*position, 0.0])) for position in positions]
    model = colmap.Reconstruction()
    model.add_camera_with_trivial_rig(sphere.camera())
    for index, (features_of, pose) in enumerate(zip(found, poses, strict=True), start=1):
        image = colmap.Image(name=f"{index}", keypoints=features_of.points, camera_id=1, image_id=index)
        model.add_image_with_trivial_frame(image, pose)
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.closing(colmap.Database.open(Path(folder) / "database.db")) as database:
            database.write_camera(model.camera(1), use_camera_id=True)
            database.write_rig(model.rig(1), use_rig_id=True)
            for index, features_of in enumerate(found, start=1):
                database.write_frame(model.frame(index), use_frame_id=True)
                database.write_image(model.image(index), use_image_id=True)
                database.write_keypoints(index, features_of.points.astype(np.float32))
            rays = [np.asarray(model.camera(1).cam_ray_from_img(features_of.points)) for features_of in found]
            pairs = _neighbouring(positions, neighbours)
            for done, (one, other) in enumerate(pairs):
                # The quick rule: which matches are wrong is told by the poses.
                matches = features.likely(found[one].descriptors, found[other].descriptors)
                matches = matches[
                    _fitting(rays[one][matches[:, 0]], rays[other][matches[:, 1]], poses[one], poses[other], sphere)
                ]
                if len(matches):
                    database.write_matches(one + 1, other + 1, matches.astype(np.uint32))
                    database.write_two_view_geometry(
                        one + 1,
                        other + 1,
                        colmap.TwoViewGeometry(
                            config=colmap.TwoViewGeometryConfiguration.CALIBRATED, inlier_matches=matches.astype(np.uint32)
                        ),
                    )
                progress(done + 1, len(pairs), "matches")
        options = colmap.IncrementalPipelineOptions()
        options.num_threads = 1
        options.random_seed = 0
        options.triangulation.random_seed = 0
        options.triangulation.ignore_two_view_tracks = False
        model = colmap.triangulate_points(model, Path(folder) / "database.db", Path(folder), Path(folder), True, options)
    numbers = sorted(model.points3D)
    row = {number: at for at, number in enumerate(numbers)}
    points = np.array([model.point3D(number).xyz for number in numbers], dtype=np.float64).reshape(-1, 3)
    point_of = [
        np.array(
            [row[point.point3D_id] if point.has_point3D() else -1 for point in model.image(index + 1).points2D], dtype=np.int64
        )
        for index in range(len(found))
    ]
    return points, point_of


def _neighbouring(positions: Float64, neighbours: int) -> list[tuple[int, int]]:
    count = min(neighbours + 1, len(positions))
    _, near = cKDTree(positions).query(positions, k=count)
    near = np.asarray(near).reshape(len(positions), count)
    return sorted({(min(i, j), max(i, j)) for i, row in enumerate(near.tolist()) for j in row if i != j})


def _fitting(one: Float64, other: Float64, first: Any, second: Any, sphere: Sphere) -> NDArray[np.bool_]:
    """Which pairs of rays lie in one plane with both cameras, seen from either, within some pixels."""
    essential = np.asarray(pycolmap().essential_matrix_from_pose(second * first.inverse()))
    most = np.sin(_EPIPOLAR_PX * 2.0 * np.pi / sphere.width)
    lines, back = one @ essential.T, other @ essential
    product = np.abs(np.sum(other * lines, axis=1))
    return np.asarray(product <= most * np.minimum(np.linalg.norm(lines, axis=1), np.linalg.norm(back, axis=1)))

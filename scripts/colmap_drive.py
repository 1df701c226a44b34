"""What structure from motion makes of a drive: COLMAP's incremental mapping with SIFT, no pose and no odometry, its scale given.

    python scripts/colmap_drive.py DATASET DRIVE...

A panorama is a strip of an equirectangular sphere, as in the peer `colmap_sift`. All pairs of images are matched and verified, and the
largest model is brought onto the true poses by the best similarity: COLMAP does not know the metre. Needs the extra ``peers``.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.local_features.kinds import Found, Sift
from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, pycolmap
from panoloc_mcl.robot.camera import Unwrapper, geometry_of
from panoloc_mcl.robot.errors import DatasetError, PanolocError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.datasets import Sequence, read_dataset, resolve_dataset

Float64 = NDArray[np.float64]
_WIDTH, _FEATURES = 1440, 4096


def mapped(drive: Sequence, folder: Path) -> list[dict[int, Float64]]:
    """Models by COLMAP, each the camera centres (3,) of images by their numbers, the largest first."""
    colmap, sift = pycolmap(), Sift(_FEATURES, ratio=0.8)
    geometry = geometry_of(drive.camera, drive.image_size)
    unwrap, sphere = Unwrapper(drive.camera, drive.image_size, geometry), Sphere(geometry, _WIDTH)
    found = [_found(sift, sphere, unwrap(read_image(file)).pixels) for file in drive.files]
    model = colmap.Reconstruction()
    model.add_camera_with_trivial_rig(sphere.camera())
    with contextlib.closing(colmap.Database.open(folder / "database.db")) as database:
        database.write_camera(model.camera(1), use_camera_id=True)
        database.write_rig(model.rig(1), use_rig_id=True)
        for index, of in enumerate(found, start=1):
            image = colmap.Image(name=f"{index}", keypoints=of.points, camera_id=1, image_id=index)
            model.add_image_with_trivial_frame(image)
            database.write_frame(model.frame(index), use_frame_id=True)
            database.write_image(model.image(index), use_image_id=True)
            database.write_keypoints(index, of.points.astype(np.float32))
            # As COLMAP keeps them: unit lengths in steps of 1/512.
            bytes_of = np.clip(np.rint(512.0 * of.descriptors), 0, 255).astype(np.uint8)
            database.write_descriptors(index, colmap.FeatureDescriptors(colmap.FeatureExtractorType.SIFT, bytes_of))
    colmap.match_exhaustive(folder / "database.db")
    options = colmap.IncrementalPipelineOptions()
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = 0
    models = colmap.incremental_mapping(folder / "database.db", folder, folder, options)
    centres = [{n - 1: np.asarray(m.image(n).projection_center()) for n in m.reg_image_ids()} for m in models.values()]
    return sorted(centres, key=len, reverse=True)


def errors_of(centres: Float64, truth: Float64) -> Float64:
    """Metres off (n,) after the best similarity onto true positions (n, 3) (Umeyama 1991)."""
    one, other = centres - centres.mean(axis=0), truth - truth.mean(axis=0)
    left, sizes, right = np.linalg.svd(other.T @ one)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = (sizes * signs).sum() / (one**2).sum()
    return np.linalg.norm(scale * one @ (left * signs @ right).T - other, axis=1)


def _found(sift: Sift, sphere: Sphere, pixels: NDArray[np.float32]) -> Found:
    points, descriptors = sift.find(sphere.strip(pixels))
    points, inside = sphere.on_sphere(points)
    return Found(points, descriptors).of(np.flatnonzero(inside))


def main() -> None:
    """Print a line for each drive."""
    if len(sys.argv) < 3:
        sys.exit(f"usage: {sys.argv[0]} DATASET DRIVE...")
    try:
        for drive in read_dataset(resolve_dataset(sys.argv[1])).select(sys.argv[2:]):
            print(told(drive), flush=True)
    except PanolocError as error:
        sys.exit(str(error))


def told(drive: Sequence) -> str:
    """How many images COLMAP places, and how well."""
    if drive.groundtruth is None:
        raise DatasetError(f"{drive.path}: has no ground truth; models are judged by it")
    with tempfile.TemporaryDirectory() as folder:
        models = mapped(drive, Path(folder))
    found = f"{drive.name}: {len(drive)} images, models of {', '.join(str(len(model)) for model in models) or 'none'}"
    if not models:
        return found
    numbers = sorted(models[0])
    truth = np.array([[*drive.groundtruth.at(drive.times[number])[:2], 0.0] for number in numbers])
    off = 1e3 * errors_of(np.array([models[0][number] for number in numbers]), truth)
    return f"{found}; the largest: median {np.median(off):.1f} mm, 95 % {np.quantile(off, 0.95):.1f}, largest {off.max():.1f}"


if __name__ == "__main__":
    main()

"""What structure from motion makes of a drive: COLMAP's incremental mapping with SIFT, no pose and no odometry, its scale given.

A panorama is a strip of an equirectangular sphere, as in the peer `colmap_sift`. All pairs of images are matched and verified, and the
largest model is brought onto the true poses by the best similarity: COLMAP does not know the metre. Needs the extra ``peers``.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.local_features.kinds import Found, Sift, found_in
from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, pycolmap
from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.robot.camera import Unwrapper, geometry_of
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.datasets import Sequence, Trajectory, read_dataset, resolve_dataset

Float64 = NDArray[np.float64]

_WIDTH, _FEATURES, _RATIO = 1440, 4096, 0.8
_HEADS = ("drive", "images", "images in each model", "the largest: median, mm", "95 %, mm", "largest, mm")


def study(dataset: str, drives: Iterable[str] = ("all",), progress: Progress = no_progress) -> Report:
    """Map each drive by itself, and hold the largest model against the truth.

    Parameters
    ----------
    dataset : str
    drives : iterable of str
        Names, or patterns of them.
    progress : callable (done, total, what)

    Raises
    ------
    DatasetError
        A name that fits no drive; a drive without ground truth.
    MapError
        The extra ``peers`` is not installed.
    """
    data = read_dataset(resolve_dataset(dataset))
    judged = {drive: _truth(drive) for drive in data.select(drives)}
    report = Report(f"COLMAP's maps of drives of `{data.name}`, each brought onto the true positions by a similarity.")
    table = report.table("", _HEADS)
    for done, (drive, truth) in enumerate(judged.items(), start=1):
        with tempfile.TemporaryDirectory() as folder:
            models = mapped(drive, Path(folder))
        off = 1e3 * errors_of(models[0], truth.at(drive.times)) if models else np.zeros(0)
        figures = [np.median(off), np.quantile(off, 0.95), off.max()] if models else [np.nan] * 3
        sizes = ", ".join(str(len(model)) for model in models) or "none"
        table.add(drive.name, len(drive), sizes, *(Number(float(figure), 1) for figure in figures))
        progress(done, len(judged), "drives")
    return report


def mapped(drive: Sequence, folder: Path) -> list[dict[int, Float64]]:
    """COLMAP's models of a drive.

    Parameters
    ----------
    drive : Sequence
    folder : Path
        For its database; empty.

    Returns
    -------
    list of dict of int to float64 (3,)
        Of each model, the largest first, the centres of the camera by the indices of the images.
    """
    colmap, sift = pycolmap(), Sift(_FEATURES, _RATIO)
    geometry = geometry_of(drive.camera, drive.image_size)
    unwrap, sphere = Unwrapper(drive.camera, drive.image_size, geometry), Sphere(geometry, _WIDTH)
    panoramas = (unwrap(read_image(file)) for file in drive.files)
    database = folder / "database.db"
    _write(database, sphere, [found_in(panorama.pixels, panorama.valid, sift, sphere) for panorama in panoramas])
    colmap.match_exhaustive(database)
    options = colmap.IncrementalPipelineOptions()
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = 0
    models = colmap.incremental_mapping(database, folder, folder, options)
    centres = [{n - 1: np.asarray(m.image(n).projection_center()) for n in m.reg_image_ids()} for m in models.values()]
    return sorted(centres, key=len, reverse=True)


def errors_of(centres: Mapping[int, Float64], truth: Float64) -> Float64:
    """How far a model is off after the best similarity onto the true positions (Umeyama 1991).

    Parameters
    ----------
    centres : mapping of int to float64 (3,)
        Of the camera, by the index of the image; n of them.
    truth : float64 (m, 3)
        Poses of all images; the plane of the robot is that of z = 0.

    Returns
    -------
    float64 (n,)
        Metres, by index.
    """
    indices = sorted(centres)
    one = np.array([centres[index] for index in indices])
    other = np.column_stack([truth[indices, :2], np.zeros(len(indices))])
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    left, sizes, right = np.linalg.svd(other.T @ one)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = (sizes * signs).sum() / (one**2).sum()
    return np.asarray(np.linalg.norm(scale * one @ (left * signs @ right).T - other, axis=1))


def _truth(drive: Sequence) -> Trajectory:
    if drive.groundtruth is None:
        raise DatasetError(f"{drive.path}: has no ground truth; models are judged by it")
    return drive.groundtruth


def _write(database: Path, sphere: Sphere, found: list[Found]) -> None:
    """The features of images, as COLMAP keeps them."""
    colmap = pycolmap()
    model = colmap.Reconstruction()
    model.add_camera_with_trivial_rig(sphere.camera())
    with contextlib.closing(colmap.Database.open(database)) as file:
        file.write_camera(model.camera(1), use_camera_id=True)
        file.write_rig(model.rig(1), use_rig_id=True)
        for number, of in enumerate(found, start=1):
            image = colmap.Image(name=f"{number}", keypoints=of.points, camera_id=1, image_id=number)
            model.add_image_with_trivial_frame(image)
            file.write_frame(model.frame(number), use_frame_id=True)
            file.write_image(model.image(number), use_image_id=True)
            file.write_keypoints(number, of.points.astype(np.float32))
            # Unit lengths in steps of 1/512.
            descriptors = np.clip(np.rint(512.0 * of.descriptors), 0, 255).astype(np.uint8)
            file.write_descriptors(number, colmap.FeatureDescriptors(colmap.FeatureExtractorType.SIFT, descriptors))

"""What references tell of the mount's yaw with all else of the camera as described: as they are, mirrored, and turned.

A convention of pixels that is off would turn mirrored images the same way; a world that is no floor and walls turns them the other way.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.images import read_image, write_image
from panoloc_mcl.robot.map.camera_search.adjustment import adjust
from panoloc_mcl.robot.map.camera_search.features import FINE_COLUMNS
from panoloc_mcl.robot.map.camera_search.references_scene import ReferencesScene
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.calibration.parameters import parameters_by_references
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

#: How the references are changed: whether mirrored, whether turned.
CHANGES = {"as they are": (False, False), "mirrored": (True, False), "turned by whole columns": (False, True)}
# Smoothing of the features, pixels: the yaw is nearly right from the beginning.
_STEPS = (1.0,) * 5


def study(dataset: str, most: int | None = None, progress: Progress = no_progress) -> Report:
    """Estimate the yaw from each.

    Parameters
    ----------
    dataset : str
        Its references are panoramas whose columns run clockwise from the heading.
    most : int, optional
        References looked at, evenly over all; all if left out.
    progress : callable (done, total, what)

    Raises
    ------
    DatasetError
        References that are no such panoramas, or that tell nothing of the camera.
    """
    data = read_dataset(resolve_dataset(dataset))
    references, camera = data.references, data.references.camera
    if not isinstance(camera, PanoramaCamera) or (camera.columns, camera.heading_column) != ("clockwise", 0.0):
        raise DatasetError(
            f"{references.path}: must be panoramas, with columns: clockwise and heading_column: 0, to be mirrored"
        )
    report = Report(f"Yaw of the mount by the references of `{data.name}`, all else of the camera as described.")
    table = report.table("", ("references", "looked at", "yaw, °", "standard deviation by the scatter of the images, °"))
    with tempfile.TemporaryDirectory() as folder:
        for done, (name, (mirrored, turned)) in enumerate(CHANGES.items(), start=1):
            some = changed(references, Path(folder), mirrored=mirrored, turned=turned)
            parameters = [one for one in parameters_by_references(camera, placed=True) if one.name == "yaw"]
            scene = ReferencesScene(some, VotesSettings(), camera, most or len(references), FINE_COLUMNS)
            found = adjust(camera, parameters, scene, schedule=_STEPS)
            sd = float(np.sqrt(found.covariance[0, 0]))
            table.add(name, found.images, Number(found.estimates[0].value, 3), Number(sd, 3))
            progress(done, len(CHANGES), "changes")
    return report


def changed(references: References, folder: Path, *, mirrored: bool, turned: bool) -> References:
    """The same places seen in a mirror along the x axis, or at any heading; the images are written to a folder."""
    rng, width = np.random.default_rng(0), references.image_size[0]
    poses, files = references.poses.copy(), []
    if mirrored:
        poses[:, 1:] *= -1.0
    for index, file in enumerate(references.files):
        image = read_image(file)
        if mirrored:
            # Column c becomes -c.
            image = np.roll(image[:, ::-1], 1, axis=1)
        if turned:
            columns = int(rng.integers(width))
            image = np.roll(image, columns, axis=1)
            poses[index, 2] += columns * 2.0 * np.pi / width
        files.append(folder / f"{mirrored}_{turned}_{index}.png")
        write_image(files[-1], image)
    return replace(references, files=tuple(files), poses=poses)

"""A calibration on disk: the camera, its mask, and pictures to look at before it is believed."""

from __future__ import annotations

from pathlib import Path

from panoloc_mcl.robot.camera import to_mapping
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.calibration.calibrate import Findings
from panoloc_mcl.tools.calibration.picture import picture_of_mask, picture_of_views, png


def write_camera(found: Findings, path: Path) -> list[Path]:
    """Write a ``camera.yaml`` with its mask and pictures beside it, each whole or not at all.

    Parameters
    ----------
    found : Findings
    path : Path
        Of the camera; the names of the others begin as its.

    Returns
    -------
    list of Path
        The files, the camera last.
    """
    mapping = to_mapping(found.camera)
    written = {}
    if found.camera.mask is not None:
        written[path.with_name(f"{path.stem}_mask.png")] = found.camera.mask.png()
        mapping["mask"] = f"{path.stem}_mask.png"
    written[path.with_name(f"{path.stem}_image.png")] = png(picture_of_mask(found.sample, found.camera))
    if found.scene is not None:
        written[path.with_name(f"{path.stem}_views.png")] = png(picture_of_views(found.scene, found.before, found.camera))
    for file, content in written.items():
        write_atomically(file, content)
    write_atomically(path, dump_yaml(mapping))
    return [*written, path]

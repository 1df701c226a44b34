"""A calibration on disk: the camera, its mask, and pictures to look at before it is believed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import AnyCamera, Unwrapper, geometry_of, to_mapping
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.map.camera_search.features import Warp
from panoloc_mcl.robot.map.camera_search.references_scene import ReferencesScene
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.calibration.calibrate import Findings

UInt8 = NDArray[np.uint8]

_WIDTH = 1080
_BODY = (60, 60, 255)  # red, as OpenCV orders colours
_TEXT = (255, 255, 255)


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
    written[path.with_name(f"{path.stem}_image.png")] = _png(_picture_of_mask(found.sample, found.camera))
    if found.scene is not None:
        written[path.with_name(f"{path.stem}_views.png")] = _png(_picture_of_views(found.scene, found.before, found.camera))
    for file, content in written.items():
        write_atomically(file, content)
    write_atomically(path, dump_yaml(mapping))
    return [*written, path]


def _picture_of_mask(image: NDArray[Any], camera: AnyCamera) -> UInt8:
    """An image with what the mask hides in red, and the panorama that is left of it."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY)
    colour = cv2.cvtColor((grey / 256).astype(np.uint8) if grey.dtype == np.uint16 else grey, cv2.COLOR_GRAY2BGR)
    if camera.mask is not None:
        hidden = ~camera.mask.world
        colour[hidden] = (0.4 * colour[hidden] + 0.6 * np.array(_BODY)).astype(np.uint8)
    size = (image.shape[1], image.shape[0])
    panorama = Unwrapper(camera, size, geometry_of(camera, size))(image).pixels
    return _stacked([("image, mask in red", colour), ("panorama", _levels(panorama))])


def _picture_of_views(scene: ReferencesScene, before: AnyCamera, after: AnyCamera) -> UInt8:
    """A reference, and its neighbour brought there by either camera, with the difference of features beside."""
    rows = []
    at = len(scene.targets) // 2
    for name, camera in (("before", before), ("after", after)):
        assert camera.height_m is not None
        panoramas = scene.panoramas(camera)
        scene.sweep(camera, 1.0)
        own, neighbour, apart = scene.pair(camera, panoramas, at)
        view = Warp(scene.geometry, camera.height_m).view(neighbour, scene.profiles[at], apart)
        seen = np.ones(scene.geometry.shape, dtype=bool) if view.valid is None else view.valid
        difference = np.abs(own.pixels - view.pixels) * seen
        rows += [
            (f"reference, {name}", _levels(own.pixels)),
            (f"its neighbour seen from there, {name}", _levels(view.pixels)),
            (f"difference, {name}", _levels(2.0 * difference)),
        ]
    return _stacked(rows)


def _png(picture: UInt8) -> bytes:
    """As a PNG file."""
    return bytes(cv2.imencode(".png", picture)[1].tobytes())


def _levels(pixels: NDArray[Any]) -> UInt8:
    return np.asarray(cv2.cvtColor(np.clip(pixels, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR))


def _stacked(rows: list[tuple[str, UInt8]]) -> UInt8:
    parts = []
    for title, part in rows:
        scale = _WIDTH / part.shape[1]
        kernel = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
        large = cv2.resize(part, (_WIDTH, max(1, round(part.shape[0] * scale))), interpolation=kernel)
        bar = np.zeros((28, _WIDTH, 3), dtype=np.uint8)
        cv2.putText(bar, title, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.55, _TEXT, 1, cv2.LINE_AA)
        parts += [bar, large]
    return np.concatenate(parts).astype(np.uint8)

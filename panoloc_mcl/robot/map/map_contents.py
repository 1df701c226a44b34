"""What a map's file holds of it: from a map to a header and arrays (`map_file.py` writes them), and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import PanoramaGeometry, camera_from_mapping, to_mapping
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.map_file import Tensors, kept_masks, masks, part
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import all_observation_settings

if TYPE_CHECKING:
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap


def contents(panorama_map: PanoramaMap) -> tuple[dict[str, Any], Tensors]:
    """Header and arrays of a map.

    Parameters
    ----------
    panorama_map : PanoramaMap

    Returns
    -------
    header : dict of str to plain values
    tensors : dict of str to ndarray
        Names begin with ``references.``, ``keyframes.`` or ``model.``.
    """
    references, keyframes, observation = panorama_map.references, panorama_map.keyframes, panorama_map.observation
    tensors: Tensors = {
        "references.pixels": references.pixels,
        "references.positions": references.positions,
        **{f"keyframes.{name}": np.ascontiguousarray(array) for name, array in keyframes.arrays().items()},
        **{f"model.{name}": np.ascontiguousarray(array) for name, array in panorama_map.arrays.items()},
    }
    if references.valid is not None:
        tensors["references.valid"] = kept_masks(references.valid)
    header = {
        "name": panorama_map.name,
        "camera": to_mapping(panorama_map.camera),
        "image_size": list(panorama_map.image_size),
        "elevation_deg": list(references.geometry.elevation_deg),
        "files": list(references.names),
        "keyframes": keyframes.header(),
        "observation": observation.model_dump(mode="json", include={"model", observation.model}),
        "seed": panorama_map.seed,
        "notes": list(panorama_map.notes),
        "found_body": panorama_map.found_body,
        "found_tilt": panorama_map.found_tilt,
    }
    return header, tensors


def fields(header: dict[str, Any], tensors: Tensors, source: str) -> dict[str, Any]:
    """The fields of a `PanoramaMap`, from what `contents` gave; a header that is damaged raises whatever it runs into.

    Parameters
    ----------
    header : dict of str to plain values
    tensors : dict of str to ndarray
    source : str
        The file, for messages.
    """
    pixels = tensors["references.pixels"]
    positions = tensors["references.positions"]
    if positions.shape != (len(pixels), 2) or not np.isfinite(positions).all():
        raise ValueError(f"{len(pixels)} references, but positions of shape {positions.shape} or not finite")
    model = part(tensors, "model")
    _check_used(model.get("used"), len(pixels))
    camera = camera_from_mapping(header["camera"], source)
    references = ReferencePanoramas(
        pixels=pixels,
        valid=masks(tensors.get("references.valid"), len(pixels)),
        positions=positions,
        names=tuple(header["files"]),
        geometry=PanoramaGeometry(pixels.shape[2], pixels.shape[1], *header["elevation_deg"]),
        camera_height_m=camera.height_m,
    )
    return {
        "name": header["name"],
        "references": references,
        "camera": camera,
        "image_size": (header["image_size"][0], header["image_size"][1]),
        "observation": all_observation_settings().model_validate(header["observation"]),
        "seed": header["seed"],
        "arrays": model,
        "keyframes": _keyframes(references, part(tensors, "keyframes"), header.get("keyframes")),
        "notes": tuple(str(note) for note in header.get("notes", ())),
        "found_body": bool(header.get("found_body", False)),
        "found_tilt": bool(header.get("found_tilt", False)),
    }


def _check_used(used: NDArray[Any] | None, count: int) -> None:
    """Refuse references that views are made from, but that are not there."""
    if used is None:
        return
    whole = used.ndim == 1 and used.dtype.kind in "iu" and len(used) > 0
    if not whole or used[0] < 0 or used[-1] >= count or (used[1:] <= used[:-1]).any():
        raise ValueError(f"views are made from references that are not among its {count}")


def _keyframes(references: ReferencePanoramas, arrays: Tensors, header: dict[str, Any] | None) -> Keyframes:
    """Keyframes as a file has them; a map of an earlier version holds positions only."""
    if header is None:
        return Keyframes.surveyed(references.names, np.pad(references.positions, ((0, 0), (0, 1))))
    return Keyframes.restored(references.names, arrays, header)

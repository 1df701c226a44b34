"""The files that a camera mapping names: its mask, and calibrations of other tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from panoloc_mcl.robot.camera.formats import read_calibration
from panoloc_mcl.robot.camera.mask import Mask
from panoloc_mcl.robot.camera.spec import AnyCamera, camera_from_mapping
from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import read_yaml


def camera_with_files(data: Mapping[str, Any], folder: Path, source: str, prefix: str = "") -> dict[str, Any]:
    """A camera mapping in which names of files are replaced by what they hold.

    Parameters
    ----------
    data : mapping
        As under ``camera:``; other values are left as they are, to be checked by whoever builds the camera.
    folder : Path
        That relative names start from.
    source : str
        What to call the mapping in a fault, usually the file.
    prefix : str
        Before the keys in a fault, such as ``camera.``.

    Raises
    ------
    CameraError
        Every fault, one line each: source, key, value and remedy.
    """
    found = dict(data)
    faults: list[str] = []
    mask = data.get("mask")
    if isinstance(mask, str) and not mask.startswith("data:"):
        try:
            found["mask"] = Mask.read(folder / mask, f"{source}: {prefix}mask")
        except CameraError as error:
            faults.extend(error.faults)
    for name in ("front", "back"):
        if isinstance(data.get(name), Mapping) and "file" in data[name]:
            try:
                found[name] = _calibrated(data[name], folder, f"{source}: {prefix}{name}.", whole=False)
            except CameraError as error:
                faults.extend(error.faults)
    if _is_ours(data.get("file"), folder):
        path = folder / str(data["file"])
        ours = camera_with_files(read_yaml(path), path.parent, str(path))
        return {**ours, **{key: value for key, value in found.items() if key != "file"}}
    if "file" in data:
        try:
            found = _calibrated(found, folder, f"{source}: {prefix}", whole=True)
        except CameraError as error:
            faults.extend(error.faults)
    if faults:
        raise CameraError(faults)
    return found


def read_camera(path: Path) -> AnyCamera:
    """A ``camera.yaml`` with all files that it names.

    Raises
    ------
    CameraError, ConfigError
        Every fault, one line each.
    """
    return camera_from_mapping(camera_with_files(read_yaml(path), path.parent, str(path)), str(path))


def _is_ours(name: Any, folder: Path) -> bool:
    """Whether a file is a ``camera.yaml`` of this package: a mapping that says what kind of camera it is."""
    if not isinstance(name, str) or Path(name).suffix.lower() not in (".yaml", ".yml"):
        return False
    try:
        return isinstance(read_yaml(folder / name).get("kind"), str)
    except ConfigError:
        return False


def _calibrated(data: Mapping[str, Any], folder: Path, where: str, *, whole: bool) -> dict[str, Any]:
    """A mapping with what its ``file`` says; what the mapping says itself beats it."""
    rest = {key: value for key, value in data.items() if key not in ("file", "camera_name")}
    name = data["file"]
    if not isinstance(name, str):
        raise CameraError(f"{where}file = {name!r}: must be the name of a calibration file")
    try:
        calibration = read_calibration(folder / name, data.get("camera_name"))
    except (CameraError, ConfigError) as error:
        raise CameraError(f"{where}file = {fault}" for fault in error.faults) from error
    if not whole and calibration.lens is None:
        raise CameraError(f"{where}file = {folder / name}: describes a full sphere; name the calibration of one fisheye")
    for key in ("lens", "profile"):
        if key in rest:
            raise CameraError(f"{where}{key}: is given beside file = {name}; keep one of them")
    return {**calibration.mapping(), **rest} if whole else {**calibration.of_one_lens(), **rest}

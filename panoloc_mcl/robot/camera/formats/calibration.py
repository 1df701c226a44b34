"""What a calibration file says."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from panoloc_mcl.robot.errors import CameraError


@dataclass(frozen=True)
class Calibration:
    """A camera as another tool describes it.

    Parameters
    ----------
    tool : str
        Whose file it is.
    lens : mapping or None
        As under ``lens`` of a camera (see `panoloc_mcl.robot.camera.lenses`); None for a full sphere.
    size_px : (int, int) or None
        Width and height of the images, where the file says so.
    """

    tool: str
    lens: Mapping[str, Any] | None
    size_px: tuple[int, int] | None = None

    def mapping(self) -> dict[str, Any]:
        """As a camera mapping, without what only the user knows: where it looks, its height, and so on."""
        if self.lens is None:
            return {"kind": "equirectangular"}
        return {"kind": "omni", **self.of_one_lens()}

    def of_one_lens(self) -> dict[str, Any]:
        """As one of two fisheyes."""
        return {"lens": self.lens, **({"size_px": list(self.size_px)} if self.size_px else {})}


def numbers_of(data: Mapping[str, Any], key: str, count: int | Sequence[int], source: str) -> list[float]:
    """A list of finite numbers.

    Raises
    ------
    CameraError
        Missing, not numbers, or another count.
    """
    counts = (count,) if isinstance(count, int) else tuple(count)
    values = data.get(key)
    if values is None:
        raise CameraError(f"{source}: key '{key}' is missing; calibrate again or add it")
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        raise CameraError(f"{source}: {key} = {values!r}: must be a list of numbers") from None
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        wanted = " or ".join(str(n) for n in counts)
        raise CameraError(f"{source}: {key} = {values!r}: must be {wanted} finite numbers; calibrate again or correct it")
    return numbers


def number_of(data: Mapping[str, Any], key: str, source: str) -> float:
    """A finite number; raises like `numbers_of`."""
    value = data.get(key)
    return numbers_of({key: None if value is None else [value]}, key, 1, source)[0]


def size_of(width: Any, height: Any, source: str) -> tuple[int, int]:
    """Width and height of images; raises like `numbers_of`."""
    found = numbers_of({"image size": [width, height]}, "image size", 2, source)
    if any(value < 1 or value != int(value) for value in found):
        raise CameraError(f"{source}: image size = {width} x {height}: must be whole pixels")
    return int(found[0]), int(found[1])

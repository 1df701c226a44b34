"""The part of a camera's images that shows the world, and not the robot, its mount or the edge of a mirror."""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import GetCoreSchemaHandler
from pydantic_core import core_schema

from panoloc_mcl.robot.errors import CameraError, ImageError
from panoloc_mcl.robot.images import read_image

_URI = "data:image/png;base64,"
_WHITE = 0.5  # of the brightest grey level


class Mask:
    """A mask of the camera's own size.

    In YAML it is the name of an image file, beside the file that names it; a map keeps the image itself, as a data URI.

    Parameters
    ----------
    world : bool (height, width)
        Pixels that show the world.
    """

    def __init__(self, world: NDArray[np.bool_]) -> None:
        self.world = np.ascontiguousarray(world, dtype=np.bool_)
        self.world.setflags(write=False)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.world.shape[1], self.world.shape[0]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mask) and np.array_equal(self.world, other.world)

    def __hash__(self) -> int:
        return hash((self.size, self.world.tobytes()))

    def __repr__(self) -> str:
        return f"Mask({self.size[0]} x {self.size[1]}, {100.0 * self.world.mean():.1f} % world)"

    @classmethod
    def read(cls, path: Path, key: str = "mask") -> Mask:
        """Read an image: white is world, black is not.

        Raises
        ------
        CameraError
            Missing, damaged, or black all over.
        """
        try:
            image = read_image(path)
        except ImageError as error:
            raise CameraError(f"{key} = {fault}" for fault in error.faults) from error
        brightest = 65535.0 if image.dtype == np.uint16 else 255.0
        levels = image if image.ndim == 2 else image[:, :, :3].mean(axis=2)
        world = np.asarray(levels >= _WHITE * brightest)
        if not world.any():
            raise CameraError(f"{key} = {path}: is black all over; paint what shows the world white")
        return cls(world)

    def png(self) -> bytes:
        """The mask as a PNG file: 255 world, 0 not."""
        return bytes(cv2.imencode(".png", self.world.astype(np.uint8) * np.uint8(255))[1].tobytes())

    @classmethod
    def _parsed(cls, value: Any) -> Mask:
        if isinstance(value, Mask):
            return value
        if not isinstance(value, str) or not value.startswith(_URI):
            raise ValueError("must be the name of an image file")
        try:
            data = base64.b64decode(value.removeprefix(_URI), validate=True)
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
        except (binascii.Error, cv2.error) as error:
            raise ValueError("holds a damaged image; name the file again") from error
        if image is None or not image.any():
            raise ValueError("holds no image, or a black one; name the file again")
        return cls(image > 127)

    def _uri(self) -> str:
        return _URI + base64.b64encode(self.png()).decode("ascii")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(lambda mask: mask._uri(), when_used="json")
        return core_schema.no_info_plain_validator_function(cls._parsed, serialization=written)

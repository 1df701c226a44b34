"""A camera that delivers one image again and again while the robot drives on: an image of then, not of now."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import FrozenCameraError
from panoloc_mcl.robot.geometry import between

Float64 = NDArray[np.float64]

# Noise alone changes every image, and a stream that doubles its frames does so within centimetres.
_MOVED_M, _MOVED_RAD = 0.05, 0.03


class FrozenCamera:
    """Remembers the last image, and where odometry was when it came first."""

    def __init__(self) -> None:
        self._seen: tuple[int, Float64 | None] | None = None

    def snapshot(self) -> list[float] | None:
        """All that is remembered, as plain numbers: the image's, and where odometry was."""
        if self._seen is None:
            return None
        digest, driven = self._seen
        return [float(digest), *([] if driven is None else driven.tolist())]

    @classmethod
    def of_snapshot(cls, values: Sequence[float] | None) -> Self:
        """What `snapshot` gave.

        Raises
        ------
        ValueError
            Not one or four numbers.
        """
        camera = cls()
        if values is not None:
            if len(values) not in (1, 4):
                raise ValueError(f"last image remembered by {len(values)} numbers")
            digest, *driven = (float(value) for value in values)
            camera._seen = int(digest), np.array(driven) if driven else None
        return camera

    def check(self, image: NDArray[Any], driven: Float64 | None) -> None:
        """Look at the next image.

        Parameters
        ----------
        image : ndarray
            As the camera delivers it.
        driven : float64 (3,) or None
            Where odometry has led to: metres and radians, in any frame that stays; None without odometry.

        Raises
        ------
        FrozenCameraError
            It is the same as before to the last bit, and shows something, although odometry has moved on.
        """
        digest = zlib.crc32(np.ascontiguousarray(image).data)
        if self._seen is None or self._seen[0] != digest:
            self._seen = (digest, driven)
            return
        before = self._seen[1]
        if driven is None or before is None or image.min() == image.max():
            return
        x, y, turn = between(before, driven)
        if np.hypot(x, y) >= _MOVED_M or abs(turn) >= _MOVED_RAD:
            raise FrozenCameraError("image is the same as before although the robot has moved: the camera is frozen")

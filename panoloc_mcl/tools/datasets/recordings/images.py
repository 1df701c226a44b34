"""Images in a recording: read one at a time, in order without looking back, in any order by looking again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.images import Image

# So many images are passed over rather than looking the place up anew.
_PASSED_OVER = 8


class ImageReel:
    """The images of one recording.

    Parameters
    ----------
    where : str
        What to call the recording in messages.
    begin : callable
        Gives what is stored of all images from a number on, in order; it may begin earlier and says with which.
    decode : callable
        From what is stored of an image to pixels; ImageError if that cannot be done.
    encode : callable
        From what is stored of an image to bytes that tell it from others.
    """

    def __init__(
        self,
        where: str,
        begin: Callable[[int], tuple[int, Iterator[Any]]],
        decode: Callable[[Any, str], Image],
        encode: Callable[[Any], bytes],
    ) -> None:
        self.where = where
        self._begin, self._decode, self._encode = begin, decode, encode
        self._lock = threading.Lock()
        self._open: Iterator[Any] | None = None
        self._next = 0
        self._last: tuple[int, Any] = (-1, None)

    def stored(self, number: int) -> Any:
        """What is stored of an image.

        Raises
        ------
        ImageError
            The recording is damaged there.
        """
        with self._lock:
            if self._last[0] == number:
                return self._last[1]
            if self._open is None or not self._next <= number <= self._next + _PASSED_OVER:
                self._next, self._open = self._begin(number)
            while True:
                item = next(self._open, None)
                self._next += 1
                if item is None:
                    self._open = None
                    raise ImageError(f"{self.where}: image {number} cannot be read, the recording is damaged; copy it again")
                if self._next > number:
                    self._last = (number, item)
                    return item

    def read(self, number: int) -> Image:
        """Pixels of an image."""
        return self._decode(self.stored(number), f"{self.where}: image {number}")

    def content(self, number: int) -> bytes:
        """Bytes that tell an image from others."""
        return self._encode(self.stored(number))


class RecordedImage:
    """One image of a reel; a `StoredImage`.

    Parameters
    ----------
    reel : ImageReel
    number : int
        Among all of the reel.
    size : (int, int)
        Width and height of the recording's images, pixels.
    """

    __slots__ = ("_number", "_reel", "_size")

    def __init__(self, reel: ImageReel, number: int, size: tuple[int, int]) -> None:
        self._reel, self._number, self._size = reel, number, size

    @property
    def name(self) -> str:
        """As a file name."""
        return f"{self._number:06d}.png"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._size

    def read(self) -> Image:
        """Decode it."""
        return self._reel.read(self._number)

    def content(self) -> bytes:
        """What it is stored as."""
        return self._reel.content(self._number)

    def __str__(self) -> str:
        return f"{self._reel.where}: image {self._number}"

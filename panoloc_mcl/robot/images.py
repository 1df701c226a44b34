"""Reading and writing of single images: PNG or JPEG, 8 or 16 bits, grey or colour."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.files import write_atomically

Image = NDArray[np.uint8] | NDArray[np.uint16]


class StoredImage(Protocol):
    """An image that lies in something else than a file of its own, such as a message of a bag or a frame of a video."""

    @property
    def name(self) -> str:
        """As a file name, ending included."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""

    def __hash__(self) -> int:
        """By what it is, or by what it holds."""

    def read(self) -> Image:
        """Decode it; `ImageError` if that cannot be done."""

    def content(self) -> bytes:
        """What it is stored as, to tell images apart; `ImageError` if that cannot be read."""


ImageSource = Path | StoredImage

_PNG_START, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"
_JPEG_PLAIN_MARKERS = {0x01, *range(0xD0, 0xD9)}
_JPEG_FRAME_MARKERS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}


def read_image(path: ImageSource) -> Image:
    """Decode an image as it is stored.

    Returns
    -------
    ndarray of uint8 or uint16, shape (height, width) or (height, width, 3 | 4)
        Grey, BGR or BGRA.

    Raises
    ------
    ImageError
        Missing, cut off, damaged, neither PNG nor JPEG, or of another bit depth.
    """
    if not isinstance(path, Path):
        return path.read()
    data = _bytes_of(path)
    if data.startswith(_PNG_START):
        whole = _PNG_END in data[-64:]
    elif data.startswith(_JPEG_START):
        # Some cameras append padding after the end marker.
        whole = _JPEG_END in data[-1024:]
    else:
        raise ImageError(f"{path}: is neither a PNG nor a JPEG file; convert it")
    # The decoder would fill a cut-off image with grey instead of failing.
    if not whole:
        raise ImageError(f"{path}: is cut off after {len(data)} bytes; copy it again")
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ImageError(f"{path}: cannot be decoded ({error.err}); copy it again") from error
    if image is None:
        raise ImageError(f"{path}: cannot be decoded, the file is damaged; copy it again")
    if image.dtype not in (np.uint8, np.uint16) or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (3, 4))):
        raise ImageError(f"{path}: holds {image.dtype} of shape {image.shape}; must be 8- or 16-bit grey, BGR or BGRA")
    decoded: Image = image
    return decoded


def write_image(path: Path, image: Image, jpeg_quality: int = 95) -> None:
    """Encode an image by its name's ending (.png, .jpg, .jpeg) and write it atomically.

    Raises
    ------
    ImageError
        Another ending, or pixels that the format cannot hold.
    DatasetError
        The file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise ImageError(f"{path}: unknown ending '{path.suffix}'; use .png, .jpg or .jpeg")
    if image.dtype not in ((np.uint8, np.uint16) if suffix == ".png" else (np.uint8,)):
        raise ImageError(f"{path}: {image.dtype} pixels do not fit {suffix}; use uint8, or uint16 with .png")
    options = [cv2.IMWRITE_PNG_COMPRESSION, 4] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    done, encoded = cv2.imencode(suffix, image, options)
    if not done:
        raise ImageError(f"{path}: an image of shape {image.shape} cannot be encoded; use grey, BGR or BGRA")
    write_atomically(path, encoded.tobytes())


def image_bytes(path: ImageSource) -> bytes:
    """What an image is stored as, undecoded.

    Raises
    ------
    ImageError
        It cannot be read.
    """
    return _bytes_of(path) if isinstance(path, Path) else path.content()


def image_size(path: ImageSource) -> tuple[int, int]:
    """Width and height of a PNG or JPEG file from its header, without decoding it.

    Raises
    ------
    ImageError
        Missing, neither PNG nor JPEG, or without a readable header.
    """
    if not isinstance(path, Path):
        return path.size
    try:
        with path.open("rb") as stream:
            start = stream.read(32)
            if start.startswith(_PNG_START) and len(start) >= 24:
                width, height = struct.unpack(">II", start[16:24])
                return int(width), int(height)
            if start.startswith(_JPEG_START):
                size = _jpeg_size(start + stream.read())
                if size is not None:
                    return size
    except OSError as error:
        raise _unreadable(path, error) from error
    raise ImageError(f"{path}: is not a whole PNG or JPEG file; convert it or copy it again")


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
        elif marker in _JPEG_PLAIN_MARKERS:
            at += 2
        elif marker in _JPEG_FRAME_MARKERS:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + int(struct.unpack(">H", data[at + 2 : at + 4])[0])
    return None


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> ImageError:
    if isinstance(error, FileNotFoundError):
        return ImageError(f"{path}: no such file; add it, or drop its row")
    return ImageError(f"{path}: cannot be read ({error.strerror}); check permissions")

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
_JPEG_SCAN_MARKER = 0xDA
# Twice what the largest 360-degree cameras deliver.
_MOST_PIXELS = 1 << 28


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
    # What stands behind the end marker is padding, or the film of a motion photo.
    if data.startswith(_PNG_START):
        whole, size = _PNG_END in data, _png_size(data)
    elif data.startswith(_JPEG_START):
        size, scan = _jpeg_frame(data)
        # A thumbnail before the scan has an end marker of its own.
        whole = _JPEG_END in data[scan:]
    else:
        raise ImageError(f"{path}: is neither a PNG nor a JPEG file; convert it")
    # The decoder would fill a cut-off image with grey instead of failing.
    if not whole:
        raise ImageError(f"{path}: is cut off after {len(data)} bytes; copy it again")
    if size is not None and size[0] * size[1] > _MOST_PIXELS:
        raise ImageError(f"{path}: says it has {size[0]} x {size[1]} pixels; must have at most {_MOST_PIXELS}: make it smaller")
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ImageError(f"{path}: cannot be decoded ({error.err}); copy it again") from error
    if image is None:
        raise ImageError(f"{path}: cannot be decoded, the file is damaged; copy it again")
    if image.dtype not in (np.uint8, np.uint16) or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (3, 4))):
        raise ImageError(f"{path}: holds {image.dtype} of shape {image.shape}; must be 8- or 16-bit grey, BGR or BGRA")
    decoded: Image = _full_depth(image) if image.dtype == np.uint16 else image
    return decoded


def _full_depth(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Sixteen bits from sensors of 10, 12 or 14 that fill only the lower ones: white is white again."""
    highest = int(image.max(initial=0))
    bits = next((bits for bits in (10, 12, 14) if highest < 1 << bits), 16)
    if bits == 16 or highest < 256:
        return image
    scaled: NDArray[np.uint16] = (image.astype(np.uint32) * 65535 // ((1 << bits) - 1)).astype(np.uint16)
    return scaled


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
            size = None
            if start.startswith(_PNG_START):
                size = _png_size(start)
            elif start.startswith(_JPEG_START):
                size = _jpeg_frame(start + stream.read())[0]
            if size is not None:
                return size
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    raise ImageError(f"{path}: is not a whole PNG or JPEG file; convert it or copy it again")


def _png_size(data: bytes) -> tuple[int, int] | None:
    if len(data) < 24:
        return None
    width, height = struct.unpack(">II", data[16:24])
    return int(width), int(height)


def _jpeg_frame(data: bytes) -> tuple[tuple[int, int] | None, int]:
    """Width and height, if the header says them, and where the pixels begin."""
    at, size = 2, None
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            break
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
        elif marker in _JPEG_PLAIN_MARKERS:
            at += 2
        elif marker == _JPEG_SCAN_MARKER:
            break
        else:
            if marker in _JPEG_FRAME_MARKERS:
                height, width = struct.unpack(">HH", data[at + 5 : at + 9])
                size = (int(width), int(height))
            at += 2 + int(struct.unpack(">H", data[at + 2 : at + 4])[0])
    return size, at


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError | ValueError) -> ImageError:
    if isinstance(error, FileNotFoundError):
        return ImageError(f"{path}: no such file; add it, or drop its row")
    why = error.strerror if isinstance(error, OSError) else error
    return ImageError(f"{path}: cannot be read ({why}); check permissions")

"""Images of cameras with two lenses that write a file for each: read as one, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from panoloc_mcl.robot.camera import AnyCamera, FisheyePairCamera
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.images import Image, ImageSource, image_bytes, image_size, read_image


@dataclass(frozen=True)
class ImagePair:
    """An image in two files, a `StoredImage`: the front lens's on the left, the back's on the right.

    Parameters
    ----------
    front, back : Path
    """

    front: Path
    back: Path

    def __str__(self) -> str:
        return f"{self.front} and {self.back}"

    @property
    def name(self) -> str:
        """That of the front."""
        return self.front.name

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of both together, pixels.

        Raises
        ------
        ImageError
            They are not of one height.
        """
        (width, height), (beside, other) = image_size(self.front), image_size(self.back)
        if height != other:
            raise ImageError(f"{self.back}: {other} rows where {self.front} has {height}; use images of one size")
        return width + beside, height

    def read(self) -> Image:
        """Decode both; `ImageError` as `read_image`, or if they do not go together."""
        front, back = read_image(self.front), read_image(self.back)
        if front.dtype != back.dtype or front.shape[0] != back.shape[0] or front.shape[2:] != back.shape[2:]:
            raise ImageError(
                f"{self.back}: {back.dtype} {back.shape} does not go with {front.dtype} {front.shape} of {self.front}"
            )
        return cast(Image, np.hstack([front, back]))

    def content(self) -> bytes:
        """Both files."""
        return image_bytes(self.front) + image_bytes(self.back)


def paired(
    files: Sequence[Path], folder: Path, camera: AnyCamera | None, faults: list[str]
) -> tuple[tuple[ImageSource, ...], AnyCamera | None]:
    """Images as a camera delivers them, and that camera as if it had joined them itself.

    Parameters
    ----------
    files : sequence of Path
        As a table names them.
    folder : Path
        Of that table.
    camera : AnyCamera or None
    faults : list of str
        Gets a line for every image whose other half is missing.
    """
    if not isinstance(camera, FisheyePairCamera) or camera.files is None:
        return tuple(files), camera
    front, back = camera.files
    found: list[ImageSource] = []
    for file in files:
        name = file.relative_to(folder).as_posix()
        other = folder / name.replace(front, back)
        if front not in name:
            faults.append(f"{folder}: file {name}: has no '{front}' in its name (camera.files); name the front lens's images")
        elif not other.is_file():
            faults.append(
                f"{folder}: file {name}: its other half {name.replace(front, back)} is missing; add it, or drop this row"
            )
        found.append(ImagePair(file, other))
    return tuple(found), camera.model_copy(update={"files": None})

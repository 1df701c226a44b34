"""Files of our own: written whole or not at all, and the folder where what can be made again is kept."""

from __future__ import annotations

import io
import json
import os
import re
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from platformdirs import user_cache_path

from panoloc_mcl.robot.errors import OutputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CACHE_VARIABLE = "PANOLOC_CACHE_DIR"


def cache_folder() -> Path:
    """Where what can be made again is kept, such as built maps and rendered light: ``PANOLOC_CACHE_DIR``, or else the user's cache."""
    chosen = os.environ.get(CACHE_VARIABLE)
    return Path(chosen).expanduser() if chosen else user_cache_path("panoloc_mcl", appauthor=False)


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a file so that no reader ever sees a part of it; folders above it are made.

    Parameters
    ----------
    path : Path
    content : bytes or str
        Text is written as UTF-8 with plain newlines.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        # mkstemp makes files private; what this package writes is meant to be shared like any other file.
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written ({error.strerror}); check permissions and free space") from error


def remove_unfinished(folder: Path) -> None:
    """Remove what `write_atomically` left in a folder, and in those below it, when its process was killed.

    Raises
    ------
    OutputError
        A file cannot be removed.
    """
    for path in list(folder.rglob(".*")):
        # As mkstemp names them.
        if re.fullmatch(r"\..+\.[a-z0-9_]{8}", path.name) and path.is_file():
            try:
                path.unlink()
            except OSError as error:
                raise OutputError(f"{path}: cannot be removed ({error.strerror}); check permissions") from error


def write_arrays(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays with a header of plain values, as NumPy's npz: each part has a checksum.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    import numpy as np

    content = io.BytesIO()
    text = np.frombuffer(json.dumps(header).encode("utf-8"), dtype=np.uint8)
    np.savez(content, allow_pickle=False, header=text, **arrays)
    write_atomically(path, content.getvalue())


def read_arrays(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[np.generic]]]:
    """Read what `write_arrays` wrote; nothing in it is executed.

    Raises
    ------
    ValueError
        Not such a file, or damaged; one line says how.
    OSError
        The file cannot be read.
    """
    import numpy as np

    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
        header = json.loads(arrays.pop("header").tobytes().decode("utf-8"))
    except (zipfile.BadZipFile, EOFError, KeyError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"not written by this program, or cut short: {error}") from error
    if not isinstance(header, dict):
        raise ValueError("its header is no mapping")
    return header, arrays

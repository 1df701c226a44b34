"""Files of our own: written whole or not at all, and the folder where what can be made again is kept."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from platformdirs import user_cache_path

from panoloc_mcl.errors import OutputError

CACHE_VARIABLE = "PANOLOC_CACHE_DIR"


def cache_folder() -> Path:
    """Where rendered data sets and built maps are kept: ``PANOLOC_CACHE_DIR``, or else the user's cache."""
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

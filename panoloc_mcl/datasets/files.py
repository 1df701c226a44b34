"""Whole files or none: writing through a temporary name and a rename."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from panoloc_mcl.errors import DatasetError


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a file so that no reader ever sees a part of it; folders above it are made.

    Parameters
    ----------
    path : Path
    content : bytes or str
        Text is written as UTF-8 with plain newlines.

    Raises
    ------
    DatasetError
        The file cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        # mkstemp makes files private; a data set is meant to be shared like any other file.
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise DatasetError(f"{path}: cannot be written ({error.strerror}); check permissions and free space") from error

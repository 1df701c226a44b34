"""Files of our own: written whole or not at all, and the folder where what can be made again is kept."""

from __future__ import annotations

import io
import json
import math
import os
import struct
import tempfile
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from platformdirs import user_cache_path

from panoloc_mcl.robot.errors import ConfigError, OutputError, PanolocError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CACHE_VARIABLE = "PANOLOC_CACHE_DIR"
#: Names of files that are being written end so.
UNFINISHED = ".unfinished"

_LONGEST_PREFIX = 200
# What reading a damaged archive of arrays may raise.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    LookupError,
    AttributeError,
    TypeError,
    ValueError,
    OverflowError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    tokenize.TokenError,
    struct.error,
)


def cache_folder() -> Path:
    """Where what can be made again is kept, such as built maps and rendered light: ``PANOLOC_CACHE_DIR``, or else the user's cache.

    A user without a home folder has one among the temporary files.

    Raises
    ------
    ConfigError
        ``PANOLOC_CACHE_DIR`` names the home folder of nobody.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return at_home(chosen, CACHE_VARIABLE)
    usual = user_cache_path("panoloc_mcl", appauthor=False)
    if usual.is_absolute():
        return usual
    return Path(tempfile.gettempdir()) / f"panoloc_mcl-{getattr(os, 'getuid', lambda: 0)()}"


def at_home(path: str | Path, key: str) -> Path:
    """A path with ``~`` and ``~user`` put in.

    Raises
    ------
    ConfigError
        No such user, or one without a home folder; ``key`` says where the path was given.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise ConfigError(f"{key} = {path}: there is no such home folder; write the whole path") from None


@contextmanager
def known_errors(kind: type[PanolocError], path: str | Path, what: str = "read") -> Iterator[None]:
    """Turn what the file system refuses (folders not permitted, names too long, disks gone) into a known error."""
    try:
        yield
    except OSError as error:
        where = error.filename if isinstance(error.filename, str) else path
        raise kind(f"{where}: cannot be {what} ({error.strerror or error}); check the path and permissions") from error


def text_of(path: Path, kind: type[PanolocError]) -> str:
    """The text of a file in UTF-8, with a byte order mark or without one; lines end with a line feed, as Python reads text.

    Raises
    ------
    kind
        It is in another encoding; names the line.
    OSError
        It cannot be read.
    """
    content = path.read_bytes()
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise kind(f"{path}:{line}: byte 0x{content[error.start]:02x} is not UTF-8; save the file in that encoding") from error


def write_atomically(path: Path, content: bytes | str | Iterable[bytes | memoryview]) -> None:
    """Write a file so that no reader ever sees a part of it; folders above it are made.

    Parameters
    ----------
    path : Path
    content : bytes, str or iterable of buffers
        Text is written as UTF-8 with plain newlines; buffers one after the other.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    content = content.encode("utf-8") if isinstance(content, str) else content
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # With its ending the name must not grow too long for the file system.
        name = path.name.encode()[:_LONGEST_PREFIX].decode(errors="ignore")
        handle, temporary = tempfile.mkstemp(prefix=f".{name}.", suffix=UNFINISHED, dir=path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.writelines([content] if isinstance(content, bytes) else content)
            # On the disk before it gets its name: after a crash there is the old file or the new one.
            stream.flush()
            os.fsync(stream.fileno())
        # mkstemp makes files private; what this package writes is meant to be shared like any other file.
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
        temporary = None
        _sync_folder(path.parent)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise _unwritable(path, why) from error
    finally:
        # After Ctrl-C, too.
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Have the folder's own entries on the disk, where the system can do so: only then is a file written."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        # Some file systems of networks cannot.
        with suppress(OSError):
            os.fsync(handle)
    finally:
        os.close(handle)


def check_writable(path: Path) -> None:
    """Refuse a file that could not be written once the work for it is done; folders above it are made.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise _unwritable(path, error.strerror) from error
    if path.is_dir():
        raise _unwritable(path, "is a folder")


def _unwritable(path: Path, why: str | None) -> OutputError:
    return OutputError(f"{path}: cannot be written ({why}); check permissions and free space")


def remove_unfinished(folder: Path) -> None:
    """Remove what `write_atomically` left in a folder, and in those below it, when its process was killed.

    Raises
    ------
    OutputError
        A file cannot be removed.
    """
    for path in list(folder.rglob(".*")):
        if path.name.endswith(UNFINISHED) and path.is_file():
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

    content = path.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as parts:
            for part in parts.infolist():
                _check_part(parts, part, len(content))
        with np.load(io.BytesIO(content), allow_pickle=False) as loaded:
            arrays = {name: loaded[name] for name in loaded.files}
        header = json.loads(arrays.pop("header").tobytes().decode("utf-8"))
    except _DAMAGED as error:
        raise ValueError(f"not written by this program, or cut short: {error}") from error
    if not isinstance(header, dict):
        raise ValueError("its header is no mapping")
    return header, arrays


def _check_part(parts: zipfile.ZipFile, part: zipfile.ZipInfo, size: int) -> None:
    """Refuse a part that would take more memory than the file has bytes, before any is taken."""
    import numpy as np

    if part.compress_type != zipfile.ZIP_STORED or part.file_size > size:
        raise ValueError(f"part {part.filename} says it holds {part.file_size} bytes in a file of {size}")
    with parts.open(part) as stream:
        version = np.lib.format.read_magic(stream)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read_header(stream)
        needed = math.prod(shape) * dtype.itemsize
        if dtype.hasobject or needed != part.file_size - stream.tell():
            raise ValueError(f"part {part.filename} says it holds {needed} bytes, and holds {part.file_size - stream.tell()}")

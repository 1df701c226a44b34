"""Data sets that come with the package: shipped in it, or rendered at first use into the user's cache."""

from __future__ import annotations

import difflib
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from panoloc_mcl.datasets.room.build import Progress, build_room
from panoloc_mcl.errors import DatasetError
from panoloc_mcl.files import CACHE_VARIABLE, cache_folder

_STALE_S = 24 * 3600.0


@dataclass(frozen=True)
class Embedded:
    """A data set that comes with the package.

    Parameters
    ----------
    description : str
    version : int
        Raised whenever the contents change.
    build : callable or None
        Renders it into a folder, reporting progress as (done, total).
    shipped : Path or None
        The folder of one that needs no rendering.
    """

    description: str
    version: int
    build: Callable[[Path, Progress | None], Path] | None = None
    shipped: Path | None = None


EMBEDDED: dict[str, Embedded] = {
    "hall": Embedded(
        "the hall of the simulator: 42 references, drives of 20 frames at noon, in the afternoon, in the evening and among people",
        1,
        shipped=Path(__file__).parent / "embedded_hall",  # made by: panoloc simulate configs/simulate_embedded.yaml
    ),
    "room": Embedded(
        "a furnished room: 20 references, drives of 20 frames at noon, in the afternoon and in the evening",
        1,
        lambda path, progress: build_room(path, progress=progress),
    ),
}


def embedded_dataset(name: str, progress: Progress | None = None) -> Path:
    """The folder of an embedded data set, rendered if it is not there yet.

    An interrupted or simultaneous first use never leaves or shows a part of a data set.

    Parameters
    ----------
    name : str
        A key of ``EMBEDDED``.
    progress : callable, optional
        Called with (images done, all images) while rendering.

    Raises
    ------
    DatasetError
        Unknown name, or a cache that cannot be written.
    """
    if name not in EMBEDDED:
        raise DatasetError(f"dataset = '{name}': no such embedded data set; known: {', '.join(EMBEDDED)}")
    entry = EMBEDDED[name]
    if entry.shipped is not None:
        return entry.shipped
    folder = cache_folder() / f"{name}-{entry.version}"
    if _is_whole(folder):
        return folder
    try:
        return _render(entry, folder, progress)
    except OSError as error:
        raise DatasetError(
            f"{folder}: cannot be written ({error.strerror or error}); set {CACHE_VARIABLE} to a folder you may write to"
        ) from error


def resolve_dataset(name_or_path: str | Path, progress: Progress | None = None) -> Path:
    """The folder of a data set given by path, or by the name of an embedded one.

    A folder of that name goes first only if it is a data set.

    Parameters
    ----------
    name_or_path : str or Path
    progress : callable, optional
        As in :func:`embedded_dataset`.

    Raises
    ------
    DatasetError
        Neither a folder nor a known name; with the nearest name.
    """
    path = Path(name_or_path).expanduser()
    if (path / "dataset.yaml").is_file():
        return path
    if str(name_or_path) in EMBEDDED:
        return embedded_dataset(str(name_or_path), progress)
    if path.is_dir():
        return path
    close = difflib.get_close_matches(str(name_or_path), EMBEDDED, n=1)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    raise DatasetError(
        f"dataset = '{name_or_path}': neither a folder nor an embedded data set ({', '.join(EMBEDDED)})"
        f"{hint or '; check the path'}"
    )


def _render(entry: Embedded, folder: Path, progress: Progress | None) -> Path:
    folder.parent.mkdir(parents=True, exist_ok=True)
    _remove_stale(folder)
    work = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    assert entry.build is not None  # it is not shipped
    try:
        entry.build(work / "data", progress)
        if folder.exists() and not _is_whole(folder):
            shutil.rmtree(folder)
        try:
            (work / "data").rename(folder)
        except OSError:
            # Another process was faster; its data set is the same.
            if not _is_whole(folder):
                raise
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return folder


def _is_whole(folder: Path) -> bool:
    # dataset.yaml is written last.
    return (folder / "dataset.yaml").is_file()


def _remove_stale(folder: Path) -> None:
    """Clear away what a killed process left long ago; a younger folder may be another process at work."""
    for left in folder.parent.glob(f".{folder.name}.*"):
        if time.time() - left.stat().st_mtime > _STALE_S:
            shutil.rmtree(left, ignore_errors=True)

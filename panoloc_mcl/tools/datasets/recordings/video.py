"""Videos: frames by PyAV, odometry and truth in tables beside them. Needs the extra ``bags``.

Beside ``drive.mp4`` may stand ``drive.odometry.tum`` (or ``.csv``, or ``drive.tum``, ``drive.csv``), ``drive.groundtruth.tum``, and
``drive.frames.csv`` with the time of each frame; without it frames have the times of the video, counted from its start.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.images import Image
from panoloc_mcl.tools.datasets.recordings.folders import stamps_beside, track_beside
from panoloc_mcl.tools.datasets.recordings.images import ImageReel
from panoloc_mcl.tools.datasets.recordings.recording import Recording

VIDEOS = (".mp4", ".mkv", ".avi", ".mov", ".webm", ".insv", ".360")


def read_video(path: Path) -> Recording:
    """Look through a video once for its frames' times.

    Raises
    ------
    DatasetError
        No video, or tables beside it that cannot be read or do not fit it.
    """
    if importlib.util.find_spec("av") is None:
        raise DatasetError(f'{path}: reading videos needs PyAV; install it: pip install "panoloc-mcl[bags]"')
    notes: list[str] = []
    times = [int(frame_ns) for frame_ns in _times(path, notes)]
    if not times:
        raise DatasetError(f"{path}: holds no frame that can be read ({'; '.join(notes) or 'no video'}); check the file")
    beside = stamps_beside(path.parent, path.stem)
    if beside is not None:
        if len(beside) < len(times):
            notes.append(f"{path.name}: {len(times)} frames, but {len(beside)} times beside it; the last frames are left out")
        stamps = beside[: len(times)]
    else:
        stamps = [time - times[0] for time in times]

    def begin(number: int) -> tuple[int, Iterator[Any]]:
        return _from(path, times, number)

    reel = ImageReel(str(path), begin, _pixels, lambda frame: bytes(_pixels(frame, "").tobytes()))
    odometry, truth = (track_beside(path.parent, path.stem, part) for part in ("odometry", "groundtruth"))
    return Recording(path.stem, path, np.array(stamps, dtype=np.int64), reel, odometry, truth, notes)


def _times(path: Path, notes: list[str]) -> Iterator[int]:
    import av

    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                return
            for frame in container.decode(video=0):
                if frame.pts is not None and frame.time_base is not None:
                    yield int(frame.pts * frame.time_base * 10**9)
    except av.FFmpegError as error:
        notes.append(f"{path.name}: is damaged ({' '.join(str(error).split())}); what comes before that is used")


def _from(path: Path, times: list[int], number: int) -> tuple[int, Iterator[Any]]:
    """Frames from the last key frame before a number on, and its own number."""
    import av

    def frames(wanted: int) -> Iterator[Any]:
        try:
            with av.open(str(path)) as container:
                stream = container.streams.video[0]
                if wanted and stream.time_base is not None:
                    container.seek(int(wanted / 10**9 / stream.time_base), stream=stream, backward=True)
                yield from container.decode(video=0)
        except av.FFmpegError:
            return

    found = frames(times[number] if number > 16 else 0)
    first = next(found, None)
    if first is None or first.pts is None or first.time_base is None:
        return 0, iter(())
    start = int(np.searchsorted(times, int(first.pts * first.time_base * 10**9)))

    def all_of_them() -> Iterator[Any]:
        yield first
        yield from found

    return start, all_of_them()


def _pixels(frame: Any, where: str) -> Image:
    grey = frame.format.name in ("gray", "gray8", "gray16le")
    return np.ascontiguousarray(frame.to_ndarray() if grey else frame.to_ndarray(format="bgr24"))

"""A live robot in the Rerun viewer: what a run shows there, as it happens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.floors import AnyLocalizer
from panoloc_mcl.robot.interface.answers import TimedPose
from panoloc_mcl.tools.live.engine import Answer
from panoloc_mcl.tools.report.rerun_sink import RerunSink
from panoloc_mcl.tools.report.sinks import Departure, Frame, Scene


class _InMemory:
    """The image of an answer; a `StoredImage`."""

    name = "live.png"

    def __init__(self, pixels: Any) -> None:
        self._pixels = pixels

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return (0, 0) if isinstance(self._pixels, ImageError) else (self._pixels.shape[1], self._pixels.shape[0])

    def read(self) -> Any:
        """The pixels, or why there are none."""
        if isinstance(self._pixels, ImageError):
            raise self._pixels
        return self._pixels

    def content(self) -> bytes:
        """Its bytes."""
        return b"" if isinstance(self._pixels, ImageError) else bytes(np.ascontiguousarray(self._pixels).tobytes())


class RerunOutput:
    """Shows answers in a viewer, or writes them into a file for it.

    Parameters
    ----------
    localizer : Localizer or FloorLocalizer
    target : str
        ``live``, or a file ending in ``.rrd``.
    """

    def __init__(self, localizer: AnyLocalizer, target: str) -> None:
        self._localizer, panorama_map = localizer, localizer.panorama_map
        self._sink = RerunSink(None if target == "live" else Path(target))
        self._sink.open(Scene("live", panorama_map.references, localizer.places, (0,), panorama_map.keyframes))
        self._sink.begin(Departure("live", 0, *localizer.particles))
        self._row = 0

    def answered(self, answer: Answer) -> None:
        """Show it."""
        localizer = self._localizer
        file = _InMemory(answer.pixels)
        frame = Frame(self._row, self._row, file, localizer.unwrapper, answer.estimate, *localizer.particles, None)
        self._sink.take(frame)
        self._row += 1

    def moved(self, robot: TimedPose, odometry: TimedPose) -> None:
        """Between images nothing is shown."""

    def close(self) -> None:
        """Hand over all that is on its way."""
        self._sink.close()

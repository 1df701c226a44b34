"""Who watches a run: the loop hands every answer to one sink, which may be nobody, files, a viewer, or several of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.tools.evaluation import SequenceRecord


@dataclass(frozen=True, eq=False)
class Scene:
    """What stays the same over all sequences.

    Parameters
    ----------
    name : str
        Of the map.
    references : ReferencePanoramas
    places : Places
        That images vote for.
    images : tuple of int
        Number of images of each run to come, in their order.
    keyframes : Keyframes, optional
        Of the map, with the relative poses between them.
    """

    name: str
    references: ReferencePanoramas
    places: Places
    images: tuple[int, ...]
    keyframes: Keyframes | None = None


@dataclass(frozen=True, eq=False)
class Departure:
    """A run over a sequence that is about to begin.

    Parameters
    ----------
    name : str
        Of the sequence.
    run : int
        0 for the first run over it.
    particles : float64 (n, 3)
        The belief before the first image; n = 0 for filters without particles. Only to be looked at: the filter works on it.
    weights : float64 (n,)
    """

    name: str
    run: int
    particles: FloatArray
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class Frame:
    """One answer of the localizer.

    Parameters
    ----------
    row : int
        Of ``steps.csv``: 0 for the first answer of the run.
    index : int
        Of the image in its sequence; images without an answer are left out.
    file : Path or StoredImage
        The image.
    unwrapper : Unwrapper
        That makes panoramas of these images.
    estimate : Estimate
        With its vote field.
    particles : float64 (n, 3)
        As in `Departure`: only to be looked at, and gone after the next image.
    weights : float64 (n,)
    truth : float64 (3,), or None
    """

    row: int
    index: int
    file: ImageSource
    unwrapper: Unwrapper
    estimate: Estimate
    particles: FloatArray
    weights: FloatArray
    truth: FloatArray | None

    @cached_property
    def panorama(self) -> NDArray[np.uint8] | None:
        """Grey panorama as the map compares it, read again only for those who ask; None for an image that cannot be used."""
        try:
            pixels = self.unwrapper(read_image(self.file)).pixels
        except ImageError:
            return None
        return np.asarray(np.clip(np.rint(pixels), 0, 255), dtype=np.uint8)


class Sink(Protocol):
    """Is shown a run as it goes on: `open`, then for each sequence and run `begin`, `take` …, `end`; at last `close`."""

    def open(self, scene: Scene) -> None:
        """The map is there, the first sequence comes next."""

    def begin(self, departure: Departure) -> None:
        """A run over a sequence begins."""

    def take(self, frame: Frame) -> None:
        """An image was answered."""

    def end(self, record: SequenceRecord) -> None:
        """The sequence is over; ``record`` has all its answers."""

    def close(self) -> None:
        """Nothing more comes, be it that all is done or that something failed."""


class NullSink:
    """Looks away."""

    def open(self, scene: Scene) -> None:
        """Ignore it."""

    def begin(self, departure: Departure) -> None:
        """Ignore it."""

    def take(self, frame: Frame) -> None:
        """Ignore it."""

    def end(self, record: SequenceRecord) -> None:
        """Ignore it."""

    def close(self) -> None:
        """Ignore it."""


class Sinks:
    """Hands everything on to several sinks, in their order.

    Parameters
    ----------
    sinks : iterable of Sink
    """

    def __init__(self, sinks: Iterable[Sink]) -> None:
        self._sinks = tuple(sinks)

    def open(self, scene: Scene) -> None:
        """To all."""
        for sink in self._sinks:
            sink.open(scene)

    def begin(self, departure: Departure) -> None:
        """To all."""
        for sink in self._sinks:
            sink.begin(departure)

    def take(self, frame: Frame) -> None:
        """To all."""
        for sink in self._sinks:
            sink.take(frame)

    def end(self, record: SequenceRecord) -> None:
        """To all."""
        for sink in self._sinks:
            sink.end(record)

    def close(self) -> None:
        """To all."""
        for sink in self._sinks:
            sink.close()

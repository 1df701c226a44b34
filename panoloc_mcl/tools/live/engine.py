"""The engine: odometry is taken at once, of the images always the newest; who is slower than his camera leaves images out."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.floors import AnyLocalizer
from panoloc_mcl.robot.interface.answers import TimedPose
from panoloc_mcl.robot.interface.messages import Image, Message, Odometry
from panoloc_mcl.robot.reasons import Reason

# Latencies that the median is over.
_REMEMBERED = 200


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of one image.

    Parameters
    ----------
    estimate : Estimate
    image : Image
    pixels : ndarray or ImageError
    latency_ms : float
        From the image's arrival to its answer.
    dropped : int
        Images left out so far because newer ones had come.
    step_ms : float
        The work alone.
    """

    estimate: Estimate
    image: Image
    pixels: NDArray[Any] | ImageError
    latency_ms: float
    dropped: int
    step_ms: float


class Output(Protocol):
    """Gets what the engine finds out."""

    def answered(self, answer: Answer) -> None:
        """An image was processed; called from the engine's thread."""

    def moved(self, robot: TimedPose, odometry: TimedPose) -> None:
        """Odometry has come: the robot's pose, and that of odometry's frame; called from the thread that gave it."""

    def close(self) -> None:
        """Nothing more comes."""


@dataclass(frozen=True)
class Figures:
    """How it goes.

    Parameters
    ----------
    status : str
        Of the last answer; "no image yet" before it.
    latency_ms, step_ms : float
        Median from arrival to answer, and of the work alone; NaN before the first.
    images, dropped : int
        Answered, and left out for newer ones.
    image_age_s : float
        Since the last image came; infinite before the first.
    odometry_age_s : float
        Since the last odometry came.
    message : str
        Of the last answer, and what does not come.
    """

    status: str
    latency_ms: float
    step_ms: float
    images: int
    dropped: int
    image_age_s: float
    odometry_age_s: float
    message: str


class Engine:
    """Feeds a localizer from any threads and tells outputs; use it as a context.

    Parameters
    ----------
    localizer : Localizer or FloorLocalizer
    outputs : sequence of Output
    keep_all : bool
        Work off every image, however long it takes: for recordings that are not played in real time.
    missing_after_s : float
        Seconds without images or odometry after which a warning names what is missing.
    notice : callable, optional
        Is told of what a bad output or image raised, and what the localizer says of every kind of trouble (`Reason`) that it has
        for the first time; the engine goes on.
    sources : (str, str)
        What to call that which does not come: images, and odometry.
    """

    def __init__(
        self,
        localizer: AnyLocalizer,
        outputs: Sequence[Output] = (),
        keep_all: bool = False,
        missing_after_s: float = 5.0,
        notice: Callable[[str], None] | None = None,
        sources: tuple[str, str] = ("image", "odometry"),
    ) -> None:
        self.localizer = localizer
        self.outputs = list(outputs)
        self._keep_all, self._missing_after_s = keep_all, missing_after_s
        self._notice = notice or (lambda text: None)
        self._told: set[Reason] = set()
        self._sources = sources
        self._changed = threading.Condition()
        self._waiting: deque[tuple[Image, float]] = deque()
        self._busy = self._stopped = False
        self._begun = time.monotonic()
        self._last_image = self._last_odometry = -np.inf
        self._last: Answer | None = None
        self._latencies: deque[tuple[float, float]] = deque(maxlen=_REMEMBERED)
        self._answered = self._dropped = 0
        self._worker = threading.Thread(target=self._work, name="panoloc-images", daemon=True)

    def __enter__(self) -> Self:
        self._worker.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()

    def put(self, message: Message) -> bool:
        """Take a message; returns at once unless all images are to be kept: whether odometry was taken, and true for all else."""
        if isinstance(message, Odometry):
            self._last_odometry = time.monotonic()
            if not self.localizer.add_odometry(message.timestamp, message.pose, message.velocity, message.covariance):
                return False
            self._tell_movement(message.timestamp)
        elif isinstance(message, Image):
            with self._changed:
                self._last_image = time.monotonic()
                if self._keep_all:
                    self._changed.wait_for(lambda: not self._waiting or self._stopped)
                self._dropped += len(self._waiting)
                self._waiting.clear()
                self._waiting.append((message, time.perf_counter()))
                self._changed.notify_all()
        return True

    def drain(self, timeout_s: float = 60.0) -> None:
        """Wait until the images that have come are processed."""
        with self._changed:
            self._changed.wait_for(lambda: (not self._waiting and not self._busy) or self._stopped, timeout_s)

    def stop(self) -> None:
        """Finish the image that is worked on and close the outputs; may be called twice."""
        with self._changed:
            if self._stopped:
                return
            self._stopped = True
            self._changed.notify_all()
        if self._worker.is_alive():
            self._worker.join()
        for output in self.outputs:
            self._guarded(output.close)

    def figures(self) -> Figures:
        """How it goes now."""
        now, last = time.monotonic(), self._last
        spent = np.array(self._latencies or [(np.nan, np.nan)])
        return Figures(
            status="no image yet" if last is None else str(last.estimate.status.value),
            latency_ms=float(np.median(spent[:, 0])),
            step_ms=float(np.median(spent[:, 1])),
            images=self._answered,
            dropped=self._dropped,
            image_age_s=now - self._last_image,
            odometry_age_s=now - self._last_odometry,
            message="; ".join([*self._missing(now), *([last.estimate.message] if last and last.estimate.message else [])]),
        )

    def _missing(self, now: float) -> list[str]:
        limit = self._missing_after_s
        last = zip(self._sources, (self._last_image, self._last_odometry), strict=True)
        silent = {name: now - max(when, self._begun) for name, when in last}
        return [f"no {name} for {seconds:.0f} s" for name, seconds in silent.items() if seconds > limit]

    def _tell_movement(self, timestamp: float) -> None:
        robot = self.localizer.pose_at(timestamp)
        frame = self.localizer.odometry_to_map(timestamp) if robot is not None else None
        if robot is not None and frame is not None:
            for output in self.outputs:
                self._guarded(lambda output=output: output.moved(robot, frame))  # type: ignore[misc]

    def _work(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: bool(self._waiting) or self._stopped)
                if self._stopped:
                    return
                image, arrived = self._waiting.popleft()
                self._busy = True
                self._changed.notify_all()
            self._guarded(lambda image=image, arrived=arrived: self._answer(image, arrived))  # type: ignore[misc]

    def _answer(self, image: Image, arrived: float) -> None:
        begun = time.perf_counter()
        pixels = image.pixels()
        estimate = self.localizer.add_image(image.timestamp, pixels)
        done = time.perf_counter()
        if estimate is None:
            return
        self._answered += 1
        if not self._told.issuperset(estimate.reasons):
            self._told.update(estimate.reasons)
            self._notice(f"image of {image.timestamp:.3f} s: {estimate.message}")
        self._last = Answer(estimate, image, pixels, 1e3 * (done - arrived), self._dropped, 1e3 * (done - begun))
        self._latencies.append((self._last.latency_ms, self._last.step_ms))
        for output in self.outputs:
            self._guarded(lambda output=output: output.answered(self._last))  # type: ignore[misc]

    def _guarded(self, work: Callable[[], None]) -> None:
        """A robot drives on whatever an output does."""
        try:
            work()
        except Exception as error:
            self._notice(f"{type(error).__name__}: {' '.join(str(error).split())}")

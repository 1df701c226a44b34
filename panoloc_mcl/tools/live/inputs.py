"""Where messages come from: a camera or a stream of video, or a recording that is played."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.interface.messages import Image, Message
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.streams import recorded

# So often a camera that gives nothing is asked again before it is opened anew.
_TRIES, _PAUSE_S = 20, 0.05


def played(drive: Drive, rate: float, stopped: threading.Event) -> Iterator[Message]:
    """Messages of a drive at the pace that they were recorded at, times ``rate``; as fast as they are taken if that is 0."""
    return paced(recorded(drive), rate, stopped)


def paced(messages: Iterable[Message], rate: float, stopped: threading.Event) -> Iterator[Message]:
    """Messages when their time comes, as `played`."""
    begun, first = time.monotonic(), None
    for message in messages:
        if stopped.is_set():
            return
        first = message.timestamp if first is None else first
        if rate > 0.0:
            # An image arrives after the odometry that is not older than it: nothing to wait for then.
            wait = (message.timestamp - first) / rate - (time.monotonic() - begun)
            if wait > 0.0 and stopped.wait(wait):
                return
        yield message


def camera_images(source: str, stopped: threading.Event) -> Iterator[Message]:
    """Images of a camera (``0``), a stream (``rtsp://…``) or a video file, through OpenCV, stamped when they come.

    A camera or stream that gives nothing is opened anew; a file ends.

    Raises
    ------
    DatasetError
        It cannot be opened at all.
    """
    is_file = Path(source).is_file()
    name: int | str = int(source) if source.isdecimal() else source
    capture = cv2.VideoCapture(name)
    if not capture.isOpened():
        raise DatasetError(
            f"input.video = '{source}': cannot be opened; give a camera's number, an rtsp:// address or a video file"
        )
    failures, index = 0, 0
    period = 1.0 / fps if is_file and (fps := capture.get(cv2.CAP_PROP_FPS)) > 0.0 else 0.0
    begun = time.monotonic()
    try:
        while not stopped.is_set():
            if period and stopped.wait(max(0.0, begun + index * period - time.monotonic())):
                return
            found, pixels = capture.read()
            if found:
                yield Image(time.time(), pixels, index)
                failures, index = 0, index + 1
                continue
            if is_file:
                return
            failures += 1
            if stopped.wait(_PAUSE_S):
                return
            if failures % _TRIES == 0:
                capture.release()
                capture = cv2.VideoCapture(name)
    finally:
        capture.release()

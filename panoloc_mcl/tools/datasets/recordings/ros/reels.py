"""The images of a bag's topic, or of two topics side by side: two fisheyes that take their images at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.images import Image
from panoloc_mcl.tools.datasets.recordings.images import ImageReel
from panoloc_mcl.tools.datasets.recordings.ros.bags import Bag
from panoloc_mcl.tools.datasets.recordings.ros.messages import pixels_of

Int64 = NDArray[np.int64]

# Stamps of two cameras that are triggered together differ by no more than this, nanoseconds.
_TOGETHER_NS = 5_000_000


def paired(stamps: Sequence[Sequence[int]]) -> tuple[Int64, Int64]:
    """Which messages of one or two topics make one image.

    Parameters
    ----------
    stamps : sequence of sequence of int
        Of each topic, nanoseconds, in the order that its messages stand in.

    Returns
    -------
    groups : int64 (n, topics)
        Numbers of messages.
    stamps : int64 (n,)
        Of the first topic, nanoseconds.
    """
    first = np.array(stamps[0], dtype=np.int64)
    if len(stamps) == 1:
        return np.arange(len(first))[:, None], first
    other = np.array(stamps[1], dtype=np.int64)
    if not len(other):
        return np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64)
    order = np.argsort(other, kind="stable")
    at = np.searchsorted(other[order], first)
    near = np.stack([order[np.clip(at - 1, 0, None)], order[np.clip(at, None, len(other) - 1)]])
    best = near[np.argmin(np.abs(other[near] - first), axis=0), np.arange(len(first))]
    together = np.abs(other[best] - first) <= _TOGETHER_NS
    return np.stack([np.flatnonzero(together), best[together]], axis=1), first[together]


def reel_of(bag: Bag, topics: Sequence[str], recorded: Sequence[Sequence[int]], groups: Int64) -> ImageReel:
    """The images of topics, those of one group side by side.

    Parameters
    ----------
    bag : Bag
    topics : sequence of str
        One or two.
    recorded : sequence of sequence of int
        Of each topic, when its messages were recorded, nanoseconds.
    groups : int64 (n, topics)
        Numbers of the messages that make an image.
    """
    times = [np.array(some, dtype=np.int64) for some in recorded]
    of_message = {(topic, int(row[column])): number for number, row in enumerate(groups) for column, topic in enumerate(topics)}

    def begin(number: int) -> tuple[int, Iterator[Any]]:
        # In bags messages stand in the order that they were recorded in, but those of one time in any.
        if bag.notes or any(np.any(np.diff(some) < 0) for some in times):
            return 0, groups_from(0, None)
        start = min(int(some[message]) for some, message in zip(times, groups[number], strict=True))
        return number, groups_from(number, start)

    def groups_from(number: int, start: int | None) -> Iterator[Any]:
        counts = {
            topic: 0 if start is None else int(np.searchsorted(some, start)) for topic, some in zip(topics, times, strict=True)
        }
        waiting: dict[int, dict[str, bytes]] = {}
        for topic, _, raw in bag.messages(topics, start):
            group = of_message.get((topic, counts[topic]))
            counts[topic] += 1
            if group is None or group < number:
                continue
            waiting.setdefault(group, {})[topic] = raw
            while len(waiting.get(number, ())) == len(topics):
                parts = waiting.pop(number)
                yield [parts[name] for name in topics]
                number += 1

    def decode(parts: list[bytes], where: str) -> Image:
        return side_by_side([_pixels(bag, topic, raw, where) for topic, raw in zip(topics, parts, strict=True)], where)

    def encode(parts: list[bytes]) -> bytes:
        return b"".join(_content(bag, topic, raw) for topic, raw in zip(topics, parts, strict=True))

    return ImageReel(f"{bag.path} {' and '.join(topics)}", begin, decode, encode)


def side_by_side(images: list[Image], where: str) -> Image:
    """Images joined from left to right.

    Raises
    ------
    ImageError
        Of other heights, types or numbers of channels.
    """
    if len(images) == 1:
        return images[0]
    kinds = {(image.shape[0], image.shape[2:], image.dtype.str) for image in images}
    if len(kinds) > 1:
        shapes = " and ".join("x".join(map(str, image.shape)) for image in images)
        raise ImageError(f"{where}: images of {shapes} cannot be joined; record both cameras alike")
    return np.asarray(cv2.hconcat(images))


def _pixels(bag: Bag, topic: str, raw: bytes, where: str) -> Image:
    try:
        message = bag.decoded(topic, raw)
    except ValueError as error:
        raise ImageError(f"{where}: {error}") from error
    return pixels_of(message, where)


def _content(bag: Bag, topic: str, raw: bytes) -> bytes:
    try:
        message = bag.decoded(topic, raw)
    except ValueError:
        return raw
    data = bytes(message.data)
    return data if hasattr(message, "format") else f"{message.encoding} {message.width} {message.step}".encode() + data

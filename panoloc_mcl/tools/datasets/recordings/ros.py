"""Bags as recordings: topics are found by their types, or named."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets.recordings.bags import Bag
from panoloc_mcl.tools.datasets.recordings.images import ImageReel
from panoloc_mcl.tools.datasets.recordings.recording import Recording
from panoloc_mcl.tools.datasets.recordings.ros_messages import (
    COMPRESSED,
    IMAGE,
    ODOMETRY,
    POSE,
    POSE_COVARIANCE,
    TF,
    pixels_of,
    planar,
    stamp_ns,
)
from panoloc_mcl.tools.datasets.recordings.tracks import Track
from panoloc_mcl.tools.datasets.recordings.transforms import Transforms
from panoloc_mcl.tools.datasets.trajectory import Trajectory


def read_bag(path: Path, settings: RecordingSettings) -> Recording:
    """Read all but the images of a bag; they are read when somebody looks at them.

    Raises
    ------
    DatasetError
        Not a bag; no image topic, or several and none named; a named topic that is not there.
    """
    bag = Bag(path)
    image_topic = _image_topic(bag, settings)
    odometry_topic = _one_of(bag, "odometry_topic", settings.odometry_topic, (ODOMETRY,), named_only=settings.truth_topic)
    truth_topic = settings.truth_topic and _one_of(bag, "truth_topic", settings.truth_topic, (POSE, POSE_COVARIANCE, ODOMETRY))
    if truth_topic is None:
        poses = [topic for topic, kind in bag.topics.items() if kind == POSE]
        truth_topic = poses[0] if len(poses) == 1 else None
    tf_topics = [topic for topic, kind in bag.topics.items() if kind == TF]
    stamps: list[int] = []
    recorded: list[int] = []
    odometry, truth, tree = Track(), Track(), Transforms()
    wanted = [topic for topic in (image_topic, odometry_topic, truth_topic) if topic is not None] + tf_topics
    unstamped = damaged = 0
    for topic, time, raw in bag.messages(wanted):
        try:
            message = bag.decoded(topic, raw)
        except ValueError:
            damaged += 1
            # Its place among the images counts all the same.
            if topic == image_topic:
                stamps.append(time)
                recorded.append(time)
            continue
        if topic in tf_topics:
            tree.add(message)
            continue
        stamp = time if settings.stamps == "recorded" else stamp_ns(message)
        if stamp == 0:
            stamp, unstamped = time, unstamped + 1
        if topic == image_topic:
            stamps.append(stamp)
            recorded.append(time)
            continue
        inner = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        (odometry if topic == odometry_topic else truth).add(stamp, planar(inner.position, inner.orientation))
    notes = list(bag.notes)
    if unstamped:
        notes.append(f"{path.name}: {unstamped} messages have no stamp; the time that they were recorded at stands for it")
    if damaged:
        notes.append(f"{path.name}: {damaged} messages are damaged; left out")
    if not stamps:
        raise DatasetError(f"{path}: topic {image_topic} holds no images; record it again")
    driven = odometry.trajectory() or tree.between(settings.odom_frame, settings.base_frame)
    true = truth.trajectory() or _moving(tree.between(settings.map_frame, settings.base_frame))
    if odometry.left_out or truth.left_out:
        notes.append(
            f"{path.name}: {odometry.left_out + truth.left_out} poses are doubled, not finite or no rotation; left out"
        )
    reel = _reel(bag, image_topic, recorded)
    return Recording(
        path.stem if path.is_file() else path.name, path, np.array(stamps, dtype=np.int64), reel, driven, true, notes
    )


def _moving(trajectory: Trajectory | None) -> Trajectory | None:
    return trajectory if trajectory is not None and len(trajectory) > 1 else None


def _reel(bag: Bag, topic: str, recorded: Sequence[int]) -> ImageReel:
    times = np.array(recorded, dtype=np.int64)

    def begin(number: int) -> tuple[int, Iterator[Any]]:
        # In bags messages stand in the order that they were recorded in, but those of one time in any.
        start = int(times[number])
        if bag.notes or np.any(np.diff(times) < 0):
            return 0, (raw for _, _, raw in bag.messages([topic]))
        return int(np.searchsorted(times, start)), (raw for _, _, raw in bag.messages([topic], start))

    def decode(raw: bytes, where: str) -> Any:
        from panoloc_mcl.robot.errors import ImageError

        try:
            message = bag.decoded(topic, raw)
        except ValueError as error:
            raise ImageError(f"{where}: {error}") from error
        return pixels_of(message, where)

    def encode(raw: bytes) -> bytes:
        try:
            message = bag.decoded(topic, raw)
        except ValueError:
            return raw
        data = bytes(message.data)
        return data if hasattr(message, "format") else f"{message.encoding} {message.width} {message.step}".encode() + data

    return ImageReel(f"{bag.path} {topic}", begin, decode, encode)


def _image_topic(bag: Bag, settings: RecordingSettings) -> str:
    if settings.image_topic is None:
        # One camera often comes twice, raw and compressed: raw says more.
        twice = {topic for topic in bag.topics if topic.rpartition("/")[0] in bag.topics and bag.topics[topic] == COMPRESSED}
        found = [topic for topic, kind in bag.topics.items() if kind in (IMAGE, COMPRESSED) and topic not in twice]
        if len(found) == 1:
            return found[0]
        if not found:
            raise DatasetError(f"{bag.path}: holds no images (topics: {_listed(bag.topics)}); record the camera's topic, too")
        raise DatasetError(f"{bag.path}: holds several image topics, {_listed(found)}; name one with recording.image_topic")
    chosen = _one_of(bag, "image_topic", settings.image_topic, (IMAGE, COMPRESSED))
    assert chosen is not None
    return chosen


def _one_of(bag: Bag, key: str, named: str | None, kinds: Sequence[str], named_only: str | None = None) -> str | None:
    if named is not None:
        kind = bag.topics.get(named)
        if kind is None:
            close = difflib.get_close_matches(named, bag.topics, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"there are: {_listed(bag.topics)}"
            raise DatasetError(f"{bag.path}: recording.{key} = '{named}': no such topic; {hint}")
        if kind not in kinds:
            raise DatasetError(f"{bag.path}: recording.{key} = '{named}': is {kind}; must be {' or '.join(kinds)}")
        return named
    found = [topic for topic, kind in bag.topics.items() if kind in kinds and topic != named_only]
    if len(found) > 1:
        raise DatasetError(f"{bag.path}: holds several topics of {kinds[0]}, {_listed(found)}; name one with recording.{key}")
    return found[0] if found else None


def _listed(topics: Any) -> str:
    names = sorted(topics)
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") if names else "none"

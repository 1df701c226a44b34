"""Bags as recordings: topics are found by their types, or named."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets.recordings.recording import Recording
from panoloc_mcl.tools.datasets.recordings.ros.bags import Bag
from panoloc_mcl.tools.datasets.recordings.ros.cameras import camera_of_info, mount_by
from panoloc_mcl.tools.datasets.recordings.ros.messages import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    ODOMETRY,
    POSE,
    POSE_COVARIANCE,
    TF,
    pose_of,
    stamp_ns,
)
from panoloc_mcl.tools.datasets.recordings.ros.reels import paired, reel_of
from panoloc_mcl.tools.datasets.recordings.ros.tracks import Track
from panoloc_mcl.tools.datasets.recordings.ros.transforms import Transforms
from panoloc_mcl.tools.datasets.trajectory import Trajectory


def read_bag(path: Path, settings: RecordingSettings) -> Recording:
    """Read all but the images of a bag; they are read when somebody looks at them.

    Raises
    ------
    DatasetError
        Not a bag; no image topic, or several and none named; a named topic that is not there.
    """
    return _Reading(Bag(path), settings).recording()


class _Reading:
    """One pass over a bag.

    Parameters
    ----------
    bag : Bag
    settings : RecordingSettings
    """

    def __init__(self, bag: Bag, settings: RecordingSettings) -> None:
        self.bag, self.settings = bag, settings
        self.image_topics = _image_topics(bag, settings)
        self.odometry_topic = _one_of(bag, "odometry_topic", settings.odometry_topic, (ODOMETRY,), but=settings.truth_topic)
        self.truth_topic = _truth_topic(bag, settings)
        # Of each image topic: stamps of its messages, and when they were recorded, nanoseconds.
        self.stamps: dict[str, list[int]] = {topic: [] for topic in self.image_topics}
        self.recorded: dict[str, list[int]] = {topic: [] for topic in self.image_topics}
        self.odometry, self.truth, self.tree = Track(), Track(), Transforms()
        self.frame, self.info = "", None
        self.counts: Counter[str] = Counter()

    def recording(self) -> Recording:
        """Read it."""
        bag, settings = self.bag, self.settings
        tf_topics = [topic for topic, kind in bag.topics.items() if kind == TF]
        info_topic = _beside(bag, self.image_topics[0])
        wanted = [self.odometry_topic, self.truth_topic, info_topic, *self.image_topics, *tf_topics]
        for topic, time, raw in bag.messages([topic for topic in wanted if topic is not None]):
            try:
                message = bag.decoded(topic, raw)
            except ValueError:
                self.counts["damaged"] += 1
                # Its place among the images counts all the same.
                self._count_image(topic, time, time)
                continue
            if topic in tf_topics:
                self.tree.add(message)
            elif topic == info_topic:
                self.info = message
            else:
                self._take(topic, time, message)
        if not self.stamps[self.image_topics[0]]:
            raise DatasetError(f"{bag.path}: topic {self.image_topics[0]} holds no images; record it again")
        groups, stamps = paired([self.stamps[topic] for topic in self.image_topics])
        if not len(groups):
            raise DatasetError(
                f"{bag.path}: no images of {' and '.join(self.image_topics)} have the same stamp; record them together"
            )
        driven = self.odometry.trajectory() or self.tree.between(settings.odom_frame, settings.base_frame)
        true = self.truth.trajectory() or _moving(self.tree.between(settings.map_frame, settings.base_frame))
        recording = Recording(
            bag.path.stem if bag.path.is_file() else bag.path.name,
            bag.path,
            stamps,
            reel_of(bag, self.image_topics, [self.recorded[topic] for topic in self.image_topics], groups),
            driven,
            true,
            self._notes(len(groups)),
        )
        base, frame = settings.base_frame, self.frame.lstrip("/")
        if self.info is not None and info_topic is not None and len(self.image_topics) == 1:
            recording.camera, note = camera_of_info(self.info, frame, self.tree, base, f"{bag.path.name} {info_topic}")
            recording.camera_note = note
        recording.mount = mount_by(self.tree, base, frame)
        return recording

    def _take(self, topic: str, time: int, message: Any) -> None:
        stamp = time if self.settings.stamps == "recorded" else stamp_ns(message)
        if stamp == 0:
            stamp = time
            self.counts["unstamped"] += 1
        if topic in self.image_topics:
            self.frame = self.frame or message.header.frame_id
            self._count_image(topic, stamp, time)
            return
        (self.odometry if topic == self.odometry_topic else self.truth).add(stamp, pose_of(message))

    def _count_image(self, topic: str, stamp: int, time: int) -> None:
        if topic in self.image_topics:
            self.stamps[topic].append(stamp)
            self.recorded[topic].append(time)

    def _notes(self, images: int) -> list[str]:
        name, notes = self.bag.path.name, list(self.bag.notes)
        if self.counts["unstamped"]:
            said = "the time that they were recorded at stands for it"
            notes.append(f"{name}: {self.counts['unstamped']} messages have no stamp; {said}")
        if self.counts["damaged"]:
            notes.append(f"{name}: {self.counts['damaged']} messages are damaged; left out")
        if left_out := self.odometry.left_out + self.truth.left_out:
            notes.append(f"{name}: {left_out} poses are doubled, not finite or no rotation; left out")
        if alone := sum(len(stamps) for stamps in self.stamps.values()) - images * len(self.image_topics):
            notes.append(f"{name}: {alone} images have none of the same time on the other topic; left out")
        return notes


def _moving(trajectory: Trajectory | None) -> Trajectory | None:
    return trajectory if trajectory is not None and len(trajectory) > 1 else None


def _truth_topic(bag: Bag, settings: RecordingSettings) -> str | None:
    if settings.truth_topic is not None:
        return _one_of(bag, "truth_topic", settings.truth_topic, (POSE, POSE_COVARIANCE, ODOMETRY))
    poses = [topic for topic, kind in bag.topics.items() if kind == POSE]
    return poses[0] if len(poses) == 1 else None


def _beside(bag: Bag, image_topic: str) -> str | None:
    """The ``CameraInfo`` of an image topic: in the same namespace, or in the one above (``image_raw/compressed``)."""
    above = image_topic.rpartition("/")[0]
    names = [f"{above}/camera_info", f"{above.rpartition('/')[0]}/camera_info"]
    return next((name for name in names if bag.topics.get(name) == CAMERA_INFO), None)


def _image_topics(bag: Bag, settings: RecordingSettings) -> list[str]:
    named = settings.image_topic
    if named is None:
        # One camera often comes twice, raw and compressed: raw says more.
        twice = {topic for topic in bag.topics if topic.rpartition("/")[0] in bag.topics and bag.topics[topic] == COMPRESSED}
        found = [topic for topic, kind in bag.topics.items() if kind in (IMAGE, COMPRESSED) and topic not in twice]
        if not found:
            raise DatasetError(f"{bag.path}: holds no images (topics: {_listed(bag.topics)}); record the camera's topic, too")
        if len(found) > 1:
            remedy = "name one with recording.image_topic, or [front, back] of two fisheyes"
            raise DatasetError(f"{bag.path}: holds several image topics, {_listed(found)}; {remedy}")
        return found
    names = [named] if isinstance(named, str) else list(named)
    return [str(_one_of(bag, "image_topic", name, (IMAGE, COMPRESSED))) for name in names]


def _one_of(bag: Bag, key: str, named: str | None, kinds: Sequence[str], but: str | None = None) -> str | None:
    if named is not None:
        kind = bag.topics.get(named)
        if kind is None:
            close = difflib.get_close_matches(named, bag.topics, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"there are: {_listed(bag.topics)}"
            raise DatasetError(f"{bag.path}: recording.{key} = '{named}': no such topic; {hint}")
        if kind not in kinds:
            raise DatasetError(f"{bag.path}: recording.{key} = '{named}': is {kind}; must be {' or '.join(kinds)}")
        return named
    found = [topic for topic, kind in bag.topics.items() if kind in kinds and topic != but]
    if len(found) > 1:
        raise DatasetError(f"{bag.path}: holds several topics of {kinds[0]}, {_listed(found)}; name one with recording.{key}")
    return found[0] if found else None


def _listed(topics: Any) -> str:
    names = sorted(topics)
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") if names else "none"

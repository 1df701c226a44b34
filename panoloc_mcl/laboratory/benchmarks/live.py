"""A running robot: latency against the work of an image, memory over the map, poses between images, and a recording of any length."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.layouts.bags import Messages, entries, nanoseconds, save_mcap, save_ros1
from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.laboratory.timing import in_a_process, memory_mb
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.interface.messages import Image, Message, Odometry
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets.recordings import sequence_of
from panoloc_mcl.tools.datasets.recordings.ros.messages import ODOMETRY
from panoloc_mcl.tools.live import Answer, Engine
from panoloc_mcl.tools.live.inputs import paced
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import recorded

# Poses asked for in a row, and how often that is done.
_ASKED, _ROUNDS = 200, 50


def live(dataset: str, seconds: float, images_s: float, megabytes: int) -> Report:
    """Play a drive in real time on one core, ask for poses, and read a long recording.

    Parameters
    ----------
    dataset : str
    seconds : float
        How long the drive is played.
    images_s : float
        Images a second.
    megabytes : int
        Of the recording that is written, as a ROS 1 bag and as an MCAP file.
    """
    data = read_dataset(resolve_dataset(dataset))
    config = config_from_mapping({})
    with tempfile.TemporaryDirectory(prefix="panoloc-live-") as folder:
        file = Path(folder) / "map.panomap"
        cached_map(data, config.observation, 0).save(file)
        size = file.stat().st_size / 1e6
        played = in_a_process(f"{__name__}:play", dataset, str(file), str(seconds), str(images_s))
        asked = in_a_process(f"{__name__}:ask", dataset, str(file))
        read = {kind: in_a_process(f"{__name__}:read_long", dataset, folder, kind, str(megabytes)) for kind in ("bag", "mcap")}
    report = Report(
        f"A drive of {data.name} played for {seconds:g} s at {images_s:g} images a second into a live localizer, on one core.",
        facts={"played": played, "asked": asked, "read": read, "map_mb": size},
    )
    table = report.table("Played in real time", ("what", "figure"))
    table.add("images that came, answered, dropped", f"{played['came']}, {played['answered']}, {played['dropped']}")
    table.add("latency / work of an image, medians", Number(played["latency_ms"] / played["step_ms"], 2))
    table.add("latency / work of an image, 95th percentiles", Number(played["latency_p95_ms"] / played["step_p95_ms"], 2))
    table.add("work of an image / time between two, median", Number(played["step_ms"] * images_s / 1e3, 2))
    table.add(
        "processor time of an image, all threads / time between two, mean", Number(played["processor_ms"] * images_s / 1e3, 2)
    )
    table.add("file of the map, MB", Number(size, 1))
    table.add("peak memory of the process over those, MB", Number(played["peak_mb"] - size, 0))
    table.add("of which before the map was loaded (Python and libraries), MB", Number(played["libraries_mb"], 0))
    table = report.table("`pose_at`, in odometry of 50 Hz, processor time", ("what", "figure"))
    table.add("median, µs", Number(asked["median_us"], 1))
    table.add("95th percentile of rounds, µs", Number(asked["p95_us"], 1))
    table = report.table(
        f"A recording of {megabytes} MB, every image looked at",
        ("recording", "MB", "images", "memory at a tenth, MB", "at the end, MB", "growth / size", "time / reading its bytes"),
    )
    for kind, one in read.items():
        growth = one["end_mb"] - one["tenth_mb"]
        table.add(
            kind,
            Number(one["size_mb"]),
            int(one["images"]),
            Number(one["tenth_mb"]),
            Number(one["end_mb"]),
            Number(growth / one["size_mb"], 4),
            Number(one["seconds"] / one["bytes_seconds"], 1),
        )
    return report


def _drive(dataset: str) -> Drive:
    return next(iter(read_dataset(resolve_dataset(dataset)).sequences.values()))


def _over_and_over(drive: Drive) -> Iterator[Message]:
    """The messages of a drive, to and fro without end: odometry goes back the way it came, and images with it."""
    messages = [message for message in recorded(drive) if isinstance(message, Image | Odometry)]
    first, last = messages[0].timestamp, messages[-1].timestamp
    for number in count():
        for message in messages if number % 2 == 0 else reversed(messages):
            within = message.timestamp - first if number % 2 == 0 else last - message.timestamp
            yield replace(message, timestamp=first + number * (last - first) + within)


class _Latencies:
    """Keeps what the engine tells of every image."""

    def __init__(self) -> None:
        self.latency_ms: list[float] = []
        self.step_ms: list[float] = []

    def answered(self, answer: Answer) -> None:
        """An image was processed."""
        self.latency_ms.append(answer.latency_ms)
        self.step_ms.append(answer.step_ms)

    def moved(self, robot: Any, odometry: Any) -> None:
        """Odometry came."""

    def close(self) -> None:
        """Nothing is open."""


def play(dataset: str, file: str, seconds: str, images_s: str) -> dict[str, float]:
    """Play in this process, on one core: latencies, work and counts."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[0]})
    libraries = memory_mb()
    drive, panorama_map = _drive(dataset), PanoramaMap.load(Path(file))
    localizer = Localizer(panorama_map, camera=drive.camera, image_size=drive.image_size)
    rate = float(images_s) * float(np.median(np.diff(drive.times)))
    kept, ended = _Latencies(), threading.Event()
    timer = threading.Timer(float(seconds), ended.set)
    timer.daemon = True
    with Engine(localizer, [kept]) as engine:
        timer.start()
        came, begun = 0, time.process_time()
        for message in paced(_over_and_over(drive), rate, ended):
            engine.put(message)
            came += isinstance(message, Image)
        engine.drain()
        figures, spent = engine.figures(), time.process_time() - begun
    return {
        "came": came,
        "answered": figures.images,
        "dropped": figures.dropped,
        "latency_ms": float(np.median(kept.latency_ms)),
        "latency_p95_ms": float(np.percentile(kept.latency_ms, 95)),
        "step_ms": float(np.median(kept.step_ms)),
        "step_p95_ms": float(np.percentile(kept.step_ms, 95)),
        "processor_ms": 1e3 * spent / max(figures.images, 1),
        "libraries_mb": libraries,
    }


def ask(dataset: str, file: str) -> dict[str, float]:
    """``pose_at`` at the stamps of odometry and between them, microseconds of the processor a call."""
    drive = _drive(dataset)
    localizer = Localizer(PanoramaMap.load(Path(file)), camera=drive.camera, image_size=drive.image_size)
    last = 0.0
    for message in islice(recorded(drive), 120):
        localizer.add(message)
        last = message.timestamp
    assert drive.odometry is not None
    poses = drive.odometry.at(np.arange(last, last + 10.0, 0.02))
    for number, pose in enumerate(poses):
        localizer.add_odometry(last + 0.02 * (number + 1), pose)
    spent: list[float] = []
    for number in range(_ROUNDS):
        asked = np.linspace(last + 0.1 * number, last + 0.1 * number + 5.0, _ASKED).tolist()
        begin = time.thread_time()
        for stamp in asked:
            localizer.pose_at(stamp)
        spent.append(1e6 * (time.thread_time() - begin) / _ASKED)
    return {"median_us": float(np.median(spent)), "p95_us": float(np.percentile(spent, 95))}


def read_long(dataset: str, folder: str, kind: str, megabytes: str) -> dict[str, float]:
    """Write a recording, then read it in a process of its own, and its bytes alone."""
    drive, path = _drive(dataset), Path(folder) / f"long.{kind}"
    ros = Messages(ros1=kind == "bag")
    (save_ros1 if kind == "bag" else save_mcap)(path, _long(drive, ros, int(megabytes) * 1_000_000), ros)
    size = path.stat().st_size
    found = in_a_process(f"{__name__}:look", dataset, str(path))
    begin = time.perf_counter()
    with path.open("rb") as stream:
        while stream.read(1 << 20):
            pass
    found["bytes_seconds"] = time.perf_counter() - begin
    path.unlink()
    return {**found, "size_mb": size / 1e6}


def _long(drive: Drive, ros: Messages, wanted: int) -> Iterator[Any]:
    """Messages of a drive again and again, until they are as many bytes as wanted."""
    messages, written = list(entries(drive, ros)), 0
    span = messages[-1][0] - messages[0][0] + nanoseconds(1.0)
    for number in count():
        for stamp, topic, kind, message in messages:
            later = stamp + number * span
            if hasattr(message, "header"):
                # Messages are frozen; their stamps are not part of what is kept.
                object.__setattr__(message.header.stamp, "sec", later // 10**9)
                object.__setattr__(message.header.stamp, "nanosec", later % 10**9)
            yield later, topic, kind, message
            written += message.data.nbytes if hasattr(message, "data") else 0 if kind != ODOMETRY else 700
            if written >= wanted:
                return


def look(dataset: str, path: str) -> dict[str, float]:
    """Read every image of a recording: memory at a tenth of them and at the end, and seconds."""
    begin = time.perf_counter()
    drive = sequence_of(Path(path), camera=_drive(dataset).camera)
    tenth = 0.0
    for number, file in enumerate(drive.files):
        read_image(file)
        if number == len(drive) // 10:
            tenth = memory_mb()
    return {"images": len(drive), "tenth_mb": tenth, "end_mb": memory_mb(), "seconds": time.perf_counter() - begin}

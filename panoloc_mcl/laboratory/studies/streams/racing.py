"""Images, odometry, questions and orders from threads of their own, as fast as they go: does a localizer stand that?"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.laboratory.timing import memory_mb
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import Image, Odometry, answers, recorded

# Between two rounds of the same drive, seconds of its clock.
_PAUSE_S = 2.0
# Somebody gives a pose, or wants another one, so often, seconds.
_ORDER_EVERY_S = 0.2
# Memory is looked at first when so much of the time is over.
_WARM_UP = 0.2
# A race goes on until each thread had so many turns, at most so many times as long: a busy machine starves some of them.
_TURNS, _AT_MOST = 5, 20


@dataclass
class Race:
    """What came of it.

    Parameters
    ----------
    calls : Counter
        By thread.
    failures : Counter
        What was raised, and what must not have been answered, by thread.
    status : Status
        After the drive at the end, which one thread alone plays.
    error_m : float
        Of its last pose.
    back_after : int
        Images of that drive until the pose was right and said to be so; -1 if it never was.
    memory_mb : (float, float)
        After the warm-up, and at the end.
    """

    calls: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)
    status: Status = Status.SEARCHING
    error_m: float = np.inf
    back_after: int = -1
    memory_mb: tuple[float, float] = (0.0, 0.0)


def study(dataset: str, seconds: float, progress: Progress = no_progress) -> Report:
    """Let threads race over the first drive of a data set with ground truth, for so long."""
    data = read_dataset(resolve_dataset(dataset))
    drive = next(drive for drive in data.sequences.values() if drive.groundtruth is not None)
    config = LocalizerConfig()
    localizer = Localizer(cached_map(data, config.observation, 0), config, camera=drive.camera, image_size=drive.image_size)
    found = race(localizer, drive, seconds, progress)
    report = Report(
        f"Four threads at once on one localizer for {seconds:g} s, over and over {data.name}, {drive.name}; then the drive once more, "
        "by one thread alone, on a clock of its own.",
        facts={"seconds": seconds, "failures": dict(found.failures), "status": found.status.value},
    )
    table = report.table("Calls", ("thread", "calls", "failures"))
    for name, calls in found.calls.items():
        table.add(name, calls, found.failures[name])
    table = report.table("Afterwards", ("what", "figure"))
    table.add("what was raised or wrong", "; ".join(sorted(set(found.failures) - set(found.calls))) or "nothing")
    table.add("status at the end of the drive", found.status.value)
    table.add("error of its last pose, mm", Number(1e3 * found.error_m, 1))
    table.add("images until the pose was back", found.back_after)
    before, after = found.memory_mb
    table.add("memory after the warm-up and at the end, MB", f"{before:.0f}, {after:.0f}")
    return report


def race(localizer: Localizer, drive: Drive, seconds: float, progress: Progress = no_progress) -> Race:
    """The race itself.

    Parameters
    ----------
    localizer : Localizer
        That of the drive's camera.
    drive : Sequence
        With ground truth.
    seconds : float
        At least; longer where a thread had fewer than five turns by then.
    progress : callable (done, total, what)
    """
    found, messages = Race(), list(recorded(drive))
    images = [message for message in messages if isinstance(message, Image)]
    odometry = [message for message in messages if isinstance(message, Odometry)]
    pixels = {message.index: message.pixels() for message in images}
    span = float(drive.times[-1] - drive.times[0]) + _PAUSE_S
    begun = time.monotonic()

    def give_odometry(number: int) -> None:
        message = odometry[number % len(odometry)]
        localizer.add_odometry(message.timestamp + span * (number // len(odometry)), message.pose)

    def give_image(number: int) -> None:
        message = images[number % len(images)]
        estimate = localizer.add_image(message.timestamp + span * (number // len(images)), pixels[message.index])
        if estimate is not None and not (np.isfinite(estimate.pose).all() and np.isfinite(estimate.covariance).all()):
            raise AssertionError("an answer is not finite")

    def ask(number: int) -> None:
        pose, frame = localizer.pose_at(), localizer.odometry_to_map()
        for answer in (pose, frame):
            if answer is not None and not np.isfinite(answer.pose).all():
                raise AssertionError("a pose is not finite")
        _ = localizer.counts, localizer.has_fix

    def order(number: int) -> None:
        time.sleep(_ORDER_EVERY_S)
        x, y = drive.groundtruth.poses[0, :2] if drive.groundtruth is not None else (0.0, 0.0)
        (localizer.relocalize, localizer.force_update, lambda: localizer.set_pose((x, y, 0.0)))[number % 3]()

    works = {"odometry": give_odometry, "images": give_image, "questions": ask, "orders": order}
    over = threading.Event()
    threads = [_looping(name, work, over, found) for name, work in works.items()]
    for thread in threads:
        thread.start()
    while (passed := time.monotonic() - begun) < seconds or (
        min(found.calls.values()) < _TURNS and passed < _AT_MOST * seconds
    ):
        progress(min(int(passed), int(seconds)), int(seconds), "racing")
        if passed > _WARM_UP * seconds and not found.memory_mb[0]:
            found.memory_mb = (memory_mb(peak=False), 0.0)
        time.sleep(min(1.0, max(0.1, seconds - passed)))
    over.set()
    for thread in threads:
        thread.join()
    found.memory_mb = (found.memory_mb[0], memory_mb(peak=False))
    # Each thread has its own clock; the drive that follows is later than all of them, however long the race was.
    _drive_alone(localizer, drive, found, later_s=span * (2 + max(found.calls.values())))
    return found


def _looping(name: str, work: Callable[[int], None], over: threading.Event, found: Race) -> threading.Thread:
    found.calls[name] = found.failures[name] = 0

    def run() -> None:
        while not over.is_set():
            try:
                work(found.calls[name])
            except Exception as error:
                found.failures[name] += 1
                found.failures[f"{name}: {type(error).__name__}: {error}"] += 1
            found.calls[name] += 1

    return threading.Thread(target=run, name=f"panoloc-race-{name}", daemon=True)


def _drive_alone(localizer: Localizer, drive: Drive, found: Race, later_s: float) -> None:
    assert drive.groundtruth is not None
    localizer.relocalize()
    later = (replace(message, timestamp=message.timestamp + later_s) for message in recorded(drive))
    for number, (image, estimate) in enumerate(answers(localizer, later), start=1):
        true = drive.groundtruth.at(image.timestamp - later_s)
        found.status, found.error_m = estimate.status, float(np.hypot(*(estimate.pose[:2] - true[:2])))
        if found.back_after < 0 and estimate.status is Status.CONVERGED and found.error_m < 0.5:
            found.back_after = number

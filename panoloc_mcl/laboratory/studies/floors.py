"""A robot that rides lifts between floors: which map it is on, found from nothing and kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Rate, Report
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.floors import FloorLocalizer
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.interface.messages import Image, Message, Odometry
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets.dataset import Sequence as Drive
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import recorded

Float64 = NDArray[np.float64]

# A ride takes so long, s; meanwhile no image comes, and odometry stands.
_RIDE_S, _ODOMETRY_S = 15.0, 0.1
# A floor is found if the answers from this image of a stay on are right; right is the map, and within this of the true pose.
_WITHIN_M = 0.25


@dataclass
class Stay:
    """What was answered on one floor, image by image."""

    floor: str
    rides: int
    right: list[bool] = field(default_factory=list)
    sure: list[bool] = field(default_factory=list)
    #: Whether the map is another one, and whether an ambiguous answer names the right one.
    elsewhere: list[bool] = field(default_factory=list)
    named: list[bool] = field(default_factory=list)


def study(
    config: RunConfig,
    floors: Sequence[str],
    seeds: int = 10,
    images: int = 10,
    rides: int = 2,
    progress: Progress = no_progress,
) -> Report:
    """Drive on a floor, ride to another, and so on.

    Parameters
    ----------
    config : RunConfig
        ``observation``, ``localizer``, ``map``, ``seed``.
    floors : sequence of str
        Data sets, one for each floor; their references make the maps, and their sequences are driven.
    seeds : int
        Robots; each has its own floors, drives and noise.
    images : int
        Seen on each floor.
    rides : int
    progress : callable (done, total, what)
    """
    data = {(one := read_dataset(resolve_dataset(name))).path.name: one for name in floors}
    maps = {name: cached_map(one, config.observation, config.seed, progress, config.map) for name, one in data.items()}
    settings = LocalizerConfig(observation=config.observation, localizer=config.localizer, seed=config.seed)
    stays: dict[int, list[Stay]] = {}
    for seed in range(seeds):
        any_drive = next(iter(next(iter(data.values())).sequences.values()))
        localizer = FloorLocalizer(maps, settings, camera=any_drive.camera, image_size=any_drive.image_size)
        stays[seed] = ridden(localizer, data, np.random.default_rng([config.seed, seed]), images, rides)
        progress(seed + 1, seeds, "floors")
    report = Report(
        f"Maps {', '.join(data)}; {seeds} robots that know nothing, {rides} rides each, {images} images a floor, in any light of its "
        f"sequences. Right: the map, and within {_WITHIN_M:g} m. Intervals are over robots."
    )
    table = report.table(
        "Floors",
        (
            "stay",
            "floor known and kept at its end",
            "images until it is",
            "sure of a wrong floor",
            "ambiguous, the right one named",
        ),
    )
    for number in range(rides + 1):
        some = [(str(seed), stay) for seed, all_of_it in stays.items() for stay in all_of_it if stay.rides == number]
        told = Counter(_until_right(stay) for _, stay in some)
        table.add(
            "from nothing" if number == 0 else f"after ride {number}",
            Rate.over((robot, stay.right[-1] and stay.sure[-1]) for robot, stay in some),
            ", ".join(f"{many} after {count}" if count else f"{many} never" for count, many in sorted(told.items())),
            Rate.over(
                (robot, sure and other) for robot, stay in some for sure, other in zip(stay.sure, stay.elsewhere, strict=True)
            ),
            Rate.over((robot, named) for robot, stay in some for named in stay.named),
        )
    return report


def ridden(
    localizer: FloorLocalizer, data: dict[str, Dataset], rng: np.random.Generator, images: int, rides: int
) -> list[Stay]:
    """One robot: its stays, in turn."""
    names = list(data)
    floor = names[int(rng.integers(len(names)))]
    clock, odometry, stays = 100.0, np.zeros(3), list[Stay]()
    for ride in range(rides + 1):
        if ride:
            floor = str(rng.choice([name for name in names if name != floor]))
            for _ in range(int(_RIDE_S / _ODOMETRY_S)):
                clock += _ODOMETRY_S
                localizer.add_odometry(clock, odometry)
        drives = [drive for drive in data[floor].sequences.values() if drive.groundtruth is not None]
        drive = drives[int(rng.integers(len(drives)))]
        begin = int(rng.integers(max(len(drive) - images, 0) + 1))
        part = drive.of(np.arange(begin, min(begin + images, len(drive))))
        stay = Stay(floor, ride)
        for message in _from_then(part, clock, odometry):
            if isinstance(message, Odometry):
                odometry, clock = message.pose, max(clock, message.timestamp)
            estimate = localizer.add(message)
            if estimate is not None and isinstance(message, Image):
                _note(stay, estimate, floor, part, message.index)
        stays.append(stay)
    return stays


def _from_then(part: Drive, clock: float, odometry: Float64) -> Iterator[Message]:
    """Messages of a part of a drive, its clock and its odometry going on from where they were."""
    first: Float64 | None = None
    shift = clock + 1.0 - float(part.times[0])
    for message in recorded(part):
        if isinstance(message, Image):
            yield Image(message.timestamp + shift, message.source, message.index)
        elif isinstance(message, Odometry) and part.times[0] - 0.5 <= message.timestamp <= part.times[-1] + 0.5:
            first = message.pose if first is None else first
            yield Odometry(message.timestamp + shift, compose(odometry, between(first, message.pose)))


def _note(stay: Stay, estimate: Estimate, floor: str, part: Drive, index: int) -> None:
    assert part.groundtruth is not None
    true = part.groundtruth.at(part.times)[index]
    off = float(np.hypot(*(estimate.pose[:2] - true[:2])))
    stay.right.append(estimate.map == floor and off <= _WITHIN_M)
    stay.sure.append(estimate.status is Status.CONVERGED)
    stay.elsewhere.append(estimate.map != floor)
    if estimate.status is Status.AMBIGUOUS and "may be on" in estimate.message:
        stay.named.append(f"{floor} (" in estimate.message)


def _until_right(stay: Stay) -> int:
    """The image from which on all answers are right and sure; 0 if there is none."""
    good = np.array(stay.right) & np.array(stay.sure)
    wrong = np.flatnonzero(~good)
    first = 0 if len(wrong) == 0 else int(wrong[-1]) + 1
    return first + 1 if first < len(good) else 0

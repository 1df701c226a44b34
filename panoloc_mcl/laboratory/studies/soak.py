"""Hours of driving with everything going wrong: random faults in images, stamps and odometry, and what must hold after every image."""

from __future__ import annotations

import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.geometry import angle_difference, between, compose
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.tools.datasets import Dataset, Sequence, read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map

Float64 = NDArray[np.float64]
Image = NDArray[Any]
Mode = Literal["monte_carlo", "kalman_orientation"]

#: Wrong beyond these, an answer that is called converged is false; and for more than so many images in a row it must not be.
WRONG_M, WRONG_DEG, MOST_IN_ROW = 1.0, 20.0, 3
# Memory is measured once everything has been used, and must not grow by more than this share.
_WARM_UP, _MOST_GROWTH = 0.2, 0.05
_ODOMETRY_S = 0.1
# Chances of a fault at an image: in its pixels, in its stamp, in the odometry up to it; and of being carried off.
_IN_IMAGE, _IN_STAMP, _IN_ODOMETRY, _CARRIED_OFF = 0.12, 0.05, 0.05, 0.005


def _half(image: Image, rng: np.random.Generator) -> Image:
    out = image.copy()
    begin = int(rng.integers(image.shape[1] // 2))
    out[:, begin : begin + image.shape[1] // 2] = 0
    return out


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    bad = rng.random(image.shape[:2]) < 0.4
    out = image.copy()
    out[bad] = rng.integers(0, 256, (int(bad.sum()), *image.shape[2:]))
    return out


def _foreign(image: Image, rng: np.random.Generator) -> Image:
    """Of nowhere: blocks of the image in another order, upside down."""
    blocks = np.array_split(image[::-1], 9, axis=1)
    return np.concatenate([blocks[index] for index in rng.permutation(9)], axis=1)


def _not_numbers(image: Image, rng: np.random.Generator) -> Image:
    out = image.astype(np.float32)
    out[rng.random(out.shape) < 0.5] = np.nan
    return out


#: Faults of images by name.
IMAGE_FAULTS: dict[str, Callable[[Image, np.random.Generator], Image]] = {
    "black image": lambda image, rng: np.zeros_like(image),
    "saturated image": lambda image, rng: np.full_like(image, 255),
    "half of it black": _half,
    "40 % noise": _noisy,
    "image of nowhere": _foreign,
    "wrong size": lambda image, rng: np.ascontiguousarray(image[:-1, :-3]),
    "no numbers": _not_numbers,
}
STAMP_FAULTS = ("stamp twice", "stamp not finite", "stamp 60 s ahead", "stamp 0.5 s late", "image missing", "images reordered")
ODOMETRY_FAULTS = (
    "odometry not finite",
    "odometry infinite",
    "odometry jumps",
    "odometry frozen",
    "odometry reset",
    "odometry missing",
)
_FROZEN, _KIDNAP, _CLOCK = "image frozen", "carried off", "clock jumps by 500 s"


@dataclass
class Findings:
    """What was done to a localizer, and what became of it."""

    updates: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    raised: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    statuses: Counter[str] = field(default_factory=Counter)
    # Answers that were sure and wrong; of these, later than allowed in a row; and by the fault that came last.
    wrong: int = 0
    too_long: int = 0
    wrong_after: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    memory_mb: tuple[float, float] = (0.0, 0.0)

    @property
    def growth(self) -> float:
        """Of the memory after the warm-up, as a share."""
        before, after = self.memory_mb
        return after / before - 1.0 if before else 0.0

    def faults_found(self) -> list[str]:
        """Everything that must not be, one line each."""
        lines = [f"{what}: {count}" for what, count in (self.raised + self.broken).items()]
        if self.growth > _MOST_GROWTH:
            lines.append(f"memory grew by {100.0 * self.growth:.1f} %")
        return lines


def study(
    dataset: str,
    updates: int = 1000,
    seed: int = 0,
    modes: tuple[Mode, ...] = ("monte_carlo", "kalman_orientation"),
    progress: Progress = no_progress,
) -> Report:
    """Drive to and fro over a data set's sequences with random faults.

    Parameters
    ----------
    dataset : str
        With ground truth.
    updates : int
        Images in each mode.
    seed : int
    modes : tuple of str
    progress : callable (done, total, what)
    """
    data = read_dataset(resolve_dataset(dataset))
    report = Report(
        f"Random faults in {updates} images a mode on {data.name}, seed {seed}. After every image: finite pose, covariance symmetric "
        f"and positive, weights that sum to one, status that fits its numbers. Wrong: converged and off by more than {WRONG_M:g} m "
        f"or {WRONG_DEG:g} degrees."
    )
    table = report.table(
        "What held",
        (
            "mode",
            "images",
            "a second",
            "errors raised",
            "broken",
            "converged",
            "sure and wrong",
            f"more than {MOST_IN_ROW} in a row",
            "memory",
        ),
    )
    kinds = report.table("Faults", ("fault", *modes, *(f"sure and wrong after it, {mode}" for mode in modes)))
    found = {mode: soak(data, mode, updates, seed, progress) for mode in modes}
    for mode, one in found.items():
        table.add(
            mode,
            str(one.updates),
            f"{one.updates / max(one.seconds, 1e-9):.1f}",
            str(one.raised.total()),
            "; ".join(one.broken) or "nothing",
            f"{100.0 * one.statuses['converged'] / max(one.updates, 1):.1f} %",
            f"{one.wrong} ({100.0 * one.wrong / max(one.updates, 1):.2f} %)",
            str(one.too_long),
            f"{one.memory_mb[0]:.0f} MB, {100.0 * one.growth:+.1f} %",
        )
    for kind in sorted(set().union(*(one.faults for one in found.values()))):
        table_row = [str(one.faults[kind]) for one in found.values()] + [str(one.wrong_after[kind]) for one in found.values()]
        kinds.add(kind, *table_row)
    return report


def soak(data: Dataset, mode: Mode, updates: int, seed: int, progress: Progress = no_progress) -> Findings:
    """One localizer in one mode."""
    config = LocalizerConfig(seed=seed, localizer=LocalizerSettings(mode=mode, initial="known_pose"))
    panorama_map = cached_map(data, config.observation, 0)
    drives = [drive for drive in data.sequences.values() if drive.groundtruth is not None and len(drive) > 2]
    world = _World(drives, np.random.default_rng(seed))
    localizer = Localizer(
        panorama_map,
        config,
        camera=drives[0].camera,
        image_size=drives[0].image_size,
        start_pose=tuple(world.pose.tolist()),
    )
    found, in_row, last_fault = Findings(), 0, "none"
    begin = time.perf_counter()
    for number in range(updates):
        for fault in world.step(localizer):
            found.faults[fault] += 1
            last_fault = fault
        try:
            estimate = world.look(localizer)
        except Exception as error:
            found.raised[f"{type(error).__name__} after {last_fault}"] += 1
            continue
        found.updates += 1
        if estimate is not None:
            found.statuses[estimate.status.value] += 1
            for what in _broken(localizer, estimate, mode):
                found.broken[what] += 1
            wrong = estimate.status is Status.CONVERGED and _is_off(estimate.pose, world.pose)
            in_row = in_row + 1 if wrong else 0
            if wrong:
                found.wrong += 1
                found.too_long += in_row > MOST_IN_ROW
                found.wrong_after[last_fault] += 1
        if number == int(_WARM_UP * updates):
            found.memory_mb = (_memory_mb(), 0.0)
        if number % 50 == 0 or number == updates - 1:
            progress(number + 1, updates, f"soak, {mode}")
    found.memory_mb = (found.memory_mb[0], _memory_mb())
    found.seconds = time.perf_counter() - begin
    return found


def _is_off(pose: Float64, true: Float64) -> bool:
    far = float(np.hypot(*(pose[:2] - true[:2]))) > WRONG_M
    return far or abs(float(np.degrees(angle_difference(pose[2], true[2])))) > WRONG_DEG


def _broken(localizer: Localizer, estimate: Estimate, mode: Mode) -> Iterator[str]:
    """What must hold and does not."""
    if not np.isfinite(estimate.pose).all():
        yield "pose not finite"
    covariance = estimate.covariance
    if not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-12):
        yield "covariance not finite or not symmetric"
    elif float(np.linalg.eigvalsh(covariance).min()) < -1e-12:
        yield "covariance not positive"
    poses, weights = localizer.particles
    if mode == "monte_carlo":
        settings = localizer.settings.monte_carlo
        if abs(float(weights.sum()) - 1.0) > 1e-6 or not (weights >= 0.0).all() or not np.isfinite(poses).all():
            yield "weights do not sum to one, or poses not finite"
        if len(poses) != settings.particles:
            yield "count of particles"
    best, limits = estimate.clusters[0], localizer.settings.status
    if estimate.status is Status.CONVERGED and best.spread_deg >= limits.converged_spread_deg:
        yield "converged with a wide heading"
    if estimate.status is Status.CONVERGED and mode == "monte_carlo" and best.spread_m >= limits.converged_spread_m:
        yield "converged with a wide position"
    if (estimate.status is Status.STALE) != (
        any(reason.value in ("nothing_counted", "pose_outdated") for reason in estimate.reasons)
    ):
        yield "stale without a reason, or the other way round"


class _World:
    """A robot that drives recorded ways to and fro, with faulty sensors."""

    def __init__(self, drives: list[Sequence], rng: np.random.Generator) -> None:
        self._drives, self._rng = drives, rng
        self._drive = drives[0]
        self._frame, self._direction = 0, 1
        self._clock, self._reported = 1000.0, np.zeros(3)
        self._images: dict[tuple[str, int], Image] = {}
        self._truth = {drive.name: drive.groundtruth.at(drive.times) for drive in drives if drive.groundtruth is not None}
        self._pending: list[tuple[float, Image]] = []
        self._frozen_image: Image | None = None
        self._odometry_frozen = 0
        self._sent: list[float] = [self._clock]
        self._next: tuple[float, Image] | None = None

    @property
    def pose(self) -> Float64:
        """Where the robot is, (3,)."""
        return np.asarray(self._truth[self._drive.name][self._frame])

    def step(self, localizer: Localizer) -> Iterator[str]:
        """Drive on to the next image; yields the faults that happen."""
        rng = self._rng
        before = self.pose
        carried = rng.random() < _CARRIED_OFF
        if carried:
            self._drive = self._drives[int(rng.integers(len(self._drives)))]
            self._frame = int(rng.integers(len(self._drive)))
            yield _KIDNAP
        else:
            if not 0 <= self._frame + self._direction < len(self._drive):
                self._direction = -self._direction
            self._frame += self._direction
        if rng.random() < _CARRIED_OFF:
            self._clock += 500.0
            yield _CLOCK
        moved = np.zeros(3) if carried else between(before, self.pose)
        yield from self._drive_on(localizer, moved)
        yield from self._take_image()

    def look(self, localizer: Localizer) -> Estimate | None:
        """Give the localizer the image, if one arrives."""
        if self._next is None:
            return localizer.add_image(float("nan"), np.zeros((1, 1), np.uint8))
        stamp, image = self._next
        return localizer.add_image(stamp, image)

    def _drive_on(self, localizer: Localizer, moved: Float64) -> Iterator[str]:
        rng = self._rng
        fault = ODOMETRY_FAULTS[int(rng.integers(len(ODOMETRY_FAULTS)))] if rng.random() < _IN_ODOMETRY else ""
        if fault:
            yield fault
        if fault == "odometry frozen":
            self._odometry_frozen = 3
        if fault == "odometry reset":
            self._reported = np.zeros(3)
        steps = max(int(rng.uniform(0.5, 1.5) / _ODOMETRY_S), 2)
        noise = 1.0 + 0.05 * rng.standard_normal(3)
        for step in range(1, steps + 1):
            self._clock += _ODOMETRY_S
            pose = compose(self._reported, moved * noise * (step / steps))
            if fault == "odometry missing":
                continue
            if self._odometry_frozen:
                pose = self._reported
            if fault == "odometry not finite" and step % 2:
                pose = np.array([np.nan, pose[1], pose[2]])
            if fault == "odometry infinite" and step % 2:
                pose = np.array([np.inf, -np.inf, 1e308])
            if fault == "odometry jumps" and step == steps // 2:
                pose = pose + np.array([50.0, -20.0, 2.0])
            localizer.add_odometry(self._clock, pose)
        if not self._odometry_frozen:
            self._reported = compose(self._reported, moved * noise)
        self._odometry_frozen = max(self._odometry_frozen - 1, 0)

    def _take_image(self) -> Iterator[str]:
        rng, stamp = self._rng, self._clock - 0.02
        image = self._image()
        if rng.random() < _IN_IMAGE:
            names = [*IMAGE_FAULTS, _FROZEN]
            name = names[int(rng.integers(len(names)))]
            yield name
            last = image if self._frozen_image is None else self._frozen_image
            image = last if name == _FROZEN else IMAGE_FAULTS[name](image, rng)
        self._frozen_image = self._image()
        self._next = (stamp, image)
        if rng.random() < _IN_STAMP:
            name = STAMP_FAULTS[int(rng.integers(len(STAMP_FAULTS)))]
            yield name
            if name in ("image missing", "images reordered"):
                # What was held back comes, late, in the place of the next one that is.
                self._pending.append(self._next)
                late = self._pending.pop(0) if name == "images reordered" and len(self._pending) > 1 else None
                self._next = late
            else:
                stamps = {
                    "stamp twice": self._sent[-1],
                    "stamp not finite": float("nan"),
                    "stamp 60 s ahead": stamp + 60.0,
                    "stamp 0.5 s late": stamp - 0.5,
                }
                self._next = (stamps[name], image)
        self._pending = self._pending[-2:]
        if self._next is not None and np.isfinite(self._next[0]):
            self._sent = [self._next[0]]

    def _image(self) -> Image:
        key = (self._drive.name, self._frame)
        if key not in self._images:
            self._images[key] = read_image(self._drive.files[self._frame])
        return self._images[key]


def _memory_mb() -> float:
    """Of this process now, megabytes; the most it ever had where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:  # noqa: PTH123
            return int(stream.read().split()[1]) * resource.getpagesize() / 2**20
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)

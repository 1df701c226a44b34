"""Drives with faults, and what must hold after every image."""

from __future__ import annotations

import contextlib
import math
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.laboratory.studies.robustness.soak.faults import Image
from panoloc_mcl.laboratory.studies.robustness.soak.remembered import RememberedModel
from panoloc_mcl.laboratory.studies.robustness.soak.world import World
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map

Float64 = NDArray[np.float64]
Mode = Literal["monte_carlo", "kalman_orientation"]

#: Wrong beyond these, an answer that is called converged is false; and for more than so many images in a row it must not be.
WRONG_M, WRONG_DEG, MOST_IN_ROW = 1.0, 20.0, 3
# Memory is measured once everything has been used, and must not grow by more than this share.
_WARM_UP, _MOST_GROWTH = 0.2, 0.05


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

    def take(self, estimate: Estimate, true: Float64, last_fault: str, broken: Iterable[str]) -> bool:
        """Count an answer; whether it is sure and wrong."""
        self.statuses[estimate.status.value] += 1
        self.broken.update(broken)
        wrong = estimate.status is Status.CONVERGED and _is_off(estimate.pose, true)
        if wrong:
            self.wrong += 1
            self.wrong_after[last_fault] += 1
        return wrong

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
    anew: bool = False,
    seconds: float = math.inf,
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
    anew : bool
        Compare an image with the map each time that it comes, as a robot does; otherwise its answer is remembered, and tracking is off.
    seconds : float
        Stop in each mode after so long, with what was done until then.
    """
    data = read_dataset(resolve_dataset(dataset))
    report = Report(
        f"Random faults in {updates} images a mode at the most on {data.name}, seed {seed}. After every image: finite pose, "
        f"covariance symmetric and positive, weights that sum to one, status that fits its numbers. "
        f"Wrong: converged and off by more than {WRONG_M:g} m or {WRONG_DEG:g} degrees, at the time that the answer is of. "
        f"Memory: from after {100 * _WARM_UP:.0f} % of the images, all of which were read before."
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
    found = {mode: soak(data, mode, updates, seed, progress, anew, seconds) for mode in modes}
    for mode, one in found.items():
        table.add(
            mode,
            str(one.updates),
            f"{one.updates / max(one.seconds, 1e-9):.1f}",
            str(one.raised.total()),
            "; ".join(one.broken) or "nothing",
            f"{100.0 * one.statuses['converged'] / max(one.statuses.total(), 1):.1f} %",
            f"{one.wrong} ({100.0 * one.wrong / max(one.statuses.total(), 1):.2f} %)",
            str(one.too_long),
            f"{one.memory_mb[0]:.0f} MB, {100.0 * one.growth:+.1f} %",
        )
    for kind in sorted(set().union(*(one.faults for one in found.values()))):
        table_row = [str(one.faults[kind]) for one in found.values()] + [str(one.wrong_after[kind]) for one in found.values()]
        kinds.add(kind, *table_row)
    return report


def soak(
    data: Dataset,
    mode: Mode,
    updates: int,
    seed: int,
    progress: Progress = no_progress,
    anew: bool = False,
    seconds: float = math.inf,
) -> Findings:
    """One localizer in one mode."""
    config = LocalizerConfig(seed=seed, localizer=LocalizerSettings(mode=mode, initial="known_pose"))
    panorama_map = cached_map(data, config.observation, 0)
    drives = [drive for drive in data.sequences.values() if drive.groundtruth is not None and len(drive) > 2]
    world = World(drives, np.random.default_rng(seed))
    model = panorama_map.observation_model(config.observation)
    shared = model if anew else cast(ObservationModel, RememberedModel(model))
    localizer = Localizer(
        panorama_map,
        config,
        camera=drives[0].camera,
        image_size=drives[0].image_size,
        start_pose=tuple(world.pose.tolist()),
        model=shared,
    )
    # All that is remembered takes its memory first, so that what grows afterwards is the localizer.
    for number, image in enumerate(world.images()):
        if not anew:
            _remember(shared, localizer, image, mode)
        if number % 50 == 0:
            progress(number, world.different, f"soak, {mode}, images")
    found, in_row, last_fault = Findings(), 0, "none"
    begin = time.perf_counter()
    for number in range(updates):
        for fault in world.step(localizer):
            found.faults[fault] += 1
            last_fault = fault
        try:
            for estimate in world.look(localizer):
                if estimate is not None:
                    wrong = found.take(
                        estimate, world.pose_at(estimate.timestamp), last_fault, _broken(localizer, estimate, mode)
                    )
                    in_row = in_row + 1 if wrong else 0
                    found.too_long += in_row > MOST_IN_ROW
        except Exception as error:
            found.raised[f"{type(error).__name__} after {last_fault}"] += 1
            continue
        found.updates += 1
        found.seconds = time.perf_counter() - begin
        if not found.memory_mb[0] and (number >= int(_WARM_UP * updates) or found.seconds > _WARM_UP * seconds):
            found.memory_mb = (_memory_mb(), 0.0)
        if found.seconds > seconds:
            break
        if number % 50 == 0 or number == updates - 1:
            progress(number + 1, updates, f"soak, {mode}")
    found.memory_mb = (found.memory_mb[0], _memory_mb())
    return found


def _remember(model: ObservationModel, localizer: Localizer, image: Image, mode: Mode) -> None:
    """Let a model that remembers see an image before it counts; one that is faulty is as good as any."""
    with contextlib.suppress(ImageError):
        model.observe(localizer.unwrapper(image), np.zeros(1) if mode == "kalman_orientation" else None)


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


def _memory_mb() -> float:
    """Of this process now, megabytes; the most it ever had where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:  # noqa: PTH123
            return int(stream.read().split()[1]) * resource.getpagesize() / 2**20
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)

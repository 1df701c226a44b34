"""Drives with faults, and what must hold after every image."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, cast

import numpy as np

from panoloc_mcl.laboratory.comparison.cell import data_digest
from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.laboratory.studies.robustness.soak.faults import Image
from panoloc_mcl.laboratory.studies.robustness.soak.findings import MOST_IN_ROW, WRONG_DEG, WRONG_M, Findings, memory_mb
from panoloc_mcl.laboratory.studies.robustness.soak.kept import Place
from panoloc_mcl.laboratory.studies.robustness.soak.remembered import RememberedModel
from panoloc_mcl.laboratory.studies.robustness.soak.world import World
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.single_blas import one_blas_thread
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map

Mode = Literal["monte_carlo", "kalman_orientation"]

# Memory is measured once so much of it is done.
_WARM_UP = 0.2
# How far it has come is kept after so many seconds.
_KEPT_EVERY_S = 30.0


def study(
    config: RunConfig,
    updates: int = 1000,
    modes: tuple[Mode, ...] = ("monte_carlo", "kalman_orientation"),
    progress: Progress = no_progress,
    anew: bool = False,
    seconds: float = math.inf,
    kept: Path | None = None,
) -> Report:
    """Drive to and fro over a data set's sequences with random faults.

    Parameters
    ----------
    config : RunConfig
        Its data set has ground truth; its seed is that of everything random.
    updates : int
        Images in each mode.
    modes : tuple of str
        Instead of the configuration's own.
    progress : callable (done, total, what)
    anew : bool
        Compare an image with the map each time that it comes, as a robot does; otherwise its answer is remembered, and tracking is off.
    seconds : float
        Stop in each mode after so long, with what was done until then.
    kept : Path, optional
        Folder where it is kept how far it has come: with the same settings, code and data it goes on there.
    """
    data = read_dataset(resolve_dataset(config.dataset))
    report = Report(
        f"Random faults in {updates} images a mode at the most on {data.name}, seed {config.seed}. After every image: finite pose, "
        f"covariance symmetric and positive, weights that sum to one, status that fits its numbers. "
        f"Wrong: converged and off by more than {WRONG_M:g} m or {WRONG_DEG:g} degrees, at the time that the answer is of. "
        f"Memory: from after {100 * _WARM_UP:.0f} % of the images, all of which were read before. Seconds are of the processor."
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
            f"runs of more than {MOST_IN_ROW}, longest",
            "memory",
        ),
    )
    columns = ("survived", "sure and wrong after it")
    kinds = report.table("Faults", ("fault", *modes, *(f"{column}, {mode}" for column in columns for mode in modes)))
    found = {mode: soak(data, config, mode, updates, progress, anew, seconds, kept) for mode in modes}
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
            "{}, {}".format(*one.long_runs),
            f"{one.memory_mb[0]:.0f} to {one.memory_mb[1]:.0f} MB, {100.0 * one.growth:+.1f} %",
        )
    for kind in sorted(set().union(*(one.faults for one in found.values()))):
        counts = [str(one.faults[kind]) for one in found.values()]
        survived = [str(one.faults[kind] - one.failed_after[kind]) for one in found.values()]
        kinds.add(kind, *counts, *survived, *(str(one.wrong_after[kind]) for one in found.values()))
    return report


def soak(
    data: Dataset,
    config: RunConfig,
    mode: Mode,
    updates: int,
    progress: Progress = no_progress,
    anew: bool = False,
    seconds: float = math.inf,
    kept: Path | None = None,
) -> Findings:
    """One localizer in one mode (see `study`)."""
    settings = config.localizer.model_copy(update={"mode": mode, "initial": "known_pose"})
    config = config.model_copy(update={"localizer": settings})
    panorama_map = cached_map(data, config.observation, 0)
    drives = [drive for drive in data.sequences.values() if drive.groundtruth is not None and len(drive) > 2]
    world = World(drives, np.random.default_rng(config.seed))
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
    place = None
    if kept is not None:
        place = Place(kept, (data_digest(data, config), config.seed, settings.model_dump_json(), config.observation, anew))
    found = Findings() if place is None else place.take_up(localizer, world)
    if found.updates >= updates:
        return found
    # All that is remembered takes its memory first, so that what grows afterwards is the localizer.
    for number, image in enumerate(world.images()):
        if not anew:
            _remember(shared, localizer, image, mode)
        if number % 50 == 0:
            progress(number, world.different, f"soak, {mode}, images")
    _drive(localizer, world, found, mode, updates, seconds, place, progress)
    return found


def _drive(
    localizer: Localizer,
    world: World,
    found: Findings,
    mode: Mode,
    updates: int,
    seconds: float,
    place: Place | None,
    progress: Progress,
) -> None:
    """Step by step until there are so many updates, or so many seconds have gone by."""
    begin, worked, before = time.perf_counter(), time.process_time(), found.seconds
    first, kept = found.updates, begin
    # BLAS is held to one thread once for all of them; asking for it at every image takes a twentieth of the time.
    with one_blas_thread():
        while found.updates < updates:
            _step(localizer, world, found, mode)
            found.seconds = before + time.process_time() - worked
            gone = time.perf_counter() - begin
            is_warm = found.updates - first > _WARM_UP * (updates - first) or gone > _WARM_UP * seconds
            if not found.memory_mb[0] and is_warm:
                found.warmed_up()
            if gone > seconds:
                break
            if found.updates % 50 == 0 or found.updates == updates:
                progress(found.updates, updates, f"soak, {mode}")
            if place is not None and begin + gone - kept > _KEPT_EVERY_S:
                place.keep(localizer, world, found)
                kept = begin + gone
    found.memory_mb = found.memory_mb[0], memory_mb()
    if place is not None:
        place.keep(localizer, world, found)


def _step(localizer: Localizer, world: World, found: Findings, mode: Mode) -> None:
    """On to the next image, whatever becomes of it."""
    for fault in world.step(localizer):
        found.befell(fault)
    found.updates += 1
    try:
        for estimate in world.look(localizer):
            if estimate is not None:
                found.take(estimate, world.pose_at(estimate.timestamp), list(_broken(localizer, estimate, mode)))
    except Exception as error:
        found.failed(error)


def _remember(model: ObservationModel, localizer: Localizer, image: Image, mode: Mode) -> None:
    """Let a model that remembers see an image before it counts; one that is faulty is as good as any."""
    with contextlib.suppress(ImageError):
        model.observe(localizer.unwrapper(image), np.zeros(1) if mode == "kalman_orientation" else None)


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

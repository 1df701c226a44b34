"""What the filter does when all goes well and when it does not: many seeds over every sequence, under each condition.

Vote fields do not depend on the seed, so each image is looked at once.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.laboratory.studies.filtering.conditions import CONDITIONS, Condition, disturbed, trips
from panoloc_mcl.laboratory.studies.filtering.filter_tables import Trip, tables
from panoloc_mcl.laboratory.studies.filtering.kidnaps import Turned
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.robot.observation.field import at_headings
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.config import RunConfig, config_from_mapping
from panoloc_mcl.tools.config.overrides import Override
from panoloc_mcl.tools.datasets import read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.datasets.splice import teleports_of
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.evaluation.record import group_of
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.runs.pipeline import Task
from panoloc_mcl.tools.streams import answers, recorded

_FOREIGN_IMAGES = 75

Overrides = Sequence[str | Override]


class Remembering:
    """An observation model that looks at each image once.

    Parameters
    ----------
    model : ObservationModel
    """

    def __init__(self, model: ObservationModel) -> None:
        self.model = model
        self.name, self.places, self.gives_heading = model.name, model.places, model.gives_heading
        self.known: dict[tuple[bytes, bool], VoteField] = {}

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of one image; at given headings, read off a field that is not refined, as the model itself does."""
        key = hashlib.blake2b(panorama.pixels.tobytes(), digest_size=16).digest(), headings is None
        if key not in self.known:
            circle = None if headings is None else 2.0 * np.pi * np.arange(panorama.pixels.shape[1]) / panorama.pixels.shape[1]
            self.known[key] = self.model.observe(panorama, circle)
        known = self.known[key]
        if headings is None:
            return known
        return replace(known, votes=at_headings(known.votes, headings), headings=headings)


@dataclass(frozen=True)
class Job:
    """The drives of one group, and what to do with them."""

    group: str
    conditions: tuple[str, ...]
    overrides: Overrides
    foreign: str | None
    seeds: int
    frames: int | None


def study(
    conditions: tuple[str, ...],
    overrides: Overrides = (),
    foreign: str | None = None,
    seeds: int = 20,
    frames: int | None = None,
    processes: int = 1,
    progress: Progress = no_progress,
) -> Report:
    """Run every sequence with every seed under every condition.

    Parameters
    ----------
    conditions : tuple of str
        Keys of `CONDITIONS`, as `chosen` gives them.
    overrides : sequence of str or Override
        Of the configuration: data set, sequences, and any other key.
    foreign : str, optional
        The data set that the condition ``foreign`` takes images of; same camera.
    seeds : int
        0 to seeds - 1, each one run over every sequence.
    frames : int, optional
        Only so many images of every sequence.
    processes : int
        Groups of sequences at work at once.
    progress : callable (done, total, what)

    Raises
    ------
    DatasetError
        Sequences without ground truth, or none at all.
    """
    config = _config(CONDITIONS["plain"], overrides)
    dataset = read_dataset(resolve_dataset(config.dataset))
    drives = dataset.select(config.sequences)
    if any(drive.groundtruth is None for drive in drives) or not drives:
        raise DatasetError(
            f"{dataset.path}: needs sequences with ground truth; use another data set, or select with --set sequences"
        )
    # The maps once, before the processes ask for them.
    for name in conditions:
        cached_map(dataset, _config(CONDITIONS[name], overrides).observation, 0, progress)
    groups = dict.fromkeys(group_of(drive.name) for drive in drives)
    jobs = [Job(group, conditions, overrides, foreign, seeds, frames) for group in groups]
    found: dict[str, list[Trip]] = defaultdict(list)
    for done, of_group in enumerate(_worked_on(jobs, processes)):
        progress(done + 1, len(jobs), "groups")
        for condition, some in of_group.items():
            found[condition] += some
    images = sum(len(drive) if frames is None else min(frames, len(drive)) for drive in drives)
    title = f"`{dataset.name}`: {len(drives)} drives, {images} images, each run with {seeds} seeds (0 to {seeds - 1})."
    return tables(title, {name: found[name] for name in conditions}, dataset.references.poses[:, :2])


def _config(condition: Condition, overrides: Overrides) -> RunConfig:
    return config_from_mapping(dict(condition.settings), "study filter", overrides)


def _worked_on(jobs: Sequence[Job], processes: int) -> Iterator[dict[str, list[Trip]]]:
    if processes == 1 or len(jobs) == 1:
        yield from map(trips_of, jobs)
        return
    # Fresh processes: a fork would copy the state of threads that it does not have.
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(trips_of, jobs)


def trips_of(job: Job) -> dict[str, list[Trip]]:
    """All runs over one group, by condition."""
    models: dict[str, tuple[PanoramaMap, Remembering]] = {}
    foreign = () if job.foreign is None else _some_files(job.foreign)
    out = {}
    _image.cache_clear()
    with threadpool_limits(1):
        for name in job.conditions:
            condition = CONDITIONS[name]
            config = _config(condition, job.overrides)
            dataset = read_dataset(resolve_dataset(config.dataset))
            key = config.observation.model_dump_json()
            if key not in models:
                panorama_map = cached_map(dataset, config.observation, 0)
                models[key] = panorama_map, Remembering(panorama_map.observation_model(config.observation))
            selected = dataset.select(config.sequences)
            drives = [drive.of(range(len(drive))[: job.frames]) for drive in selected if group_of(drive.name) == job.group]
            owner = {file: drive.name for drive in drives for file in drive.files}
            out[name] = [
                run(task, condition, config, seed, *models[key], owner, foreign, turns)
                for seed in range(job.seeds)
                for task, turns in trips(drives, condition, seed, models[key][0].geometry.width)
            ]
    return out


def _some_files(name: str) -> tuple[ImageSource, ...]:
    dataset = read_dataset(resolve_dataset(name))
    files = [file for drive in dataset.sequences.values() for file in drive.files]
    return tuple(files[:: max(1, len(files) // _FOREIGN_IMAGES)])


@lru_cache(maxsize=10_000)
def _image(file: ImageSource) -> NDArray[Any]:
    return read_image(file)


def run(
    task: Task,
    condition: Condition,
    config: RunConfig,
    seed: int,
    panorama_map: PanoramaMap,
    model: Remembering,
    owner: Mapping[ImageSource, str],
    foreign: Sequence[ImageSource],
    turns: NDArray[np.int64] | None,
) -> Trip:
    """One run over one drive; the seed is that of ``panoloc run`` with as many repeats. ``owner`` says of which drive each image is.

    Turned images are none that was looked at before.
    """
    assert task.drive.groundtruth is not None
    truth = task.drive.groundtruth.at(task.drive.times)
    drive, arrival, kept = disturbed(task.drive, condition, seed, foreign)
    x, y, heading = (float(value) for value in truth[0])
    localizer = Localizer(
        panorama_map,
        config,
        camera=drive.camera,
        image_size=drive.image_size,
        start_pose=(x, y, heading),
        seed=(config.seed + seed, zlib.crc32(drive.name.encode())),
        model=cast(ObservationModel, model if turns is None else Turned(model.model, turns)),
    )
    # By the time of the pose: after a late image the answer is that to the newest one, bettered.
    answered: Mapping[float, Estimate] = {
        estimate.timestamp: estimate for _, estimate in answers(localizer, recorded(drive, arrival, kept, _image))
    }
    frames = np.searchsorted(drive.times, list(answered))
    record = SequenceRecord(
        name=drive.name,
        run=seed,
        times=drive.times[frames],
        poses=np.array([estimate.pose for estimate in answered.values()]),
        truth=truth[frames],
        status=tuple(estimate.status.value for estimate in answered.values()),
        best_place=np.array([estimate.best_place for estimate in answered.values()]),
        step_ms=np.array([sum(estimate.stage_ms.values()) for estimate in answered.values()]),
        kidnapped=teleports_of(task.kidnapped, frames),
    )
    return Trip(record, tuple(owner[task.drive.files[frame]] for frame in frames))

"""One cell of a comparison: key it by all that it depends on, and run it."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import cast

import numpy as np
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.comparison.alone import look
from panoloc_mcl.laboratory.comparison.matrix import Cell
from panoloc_mcl.laboratory.comparison.runs import FORMAT, Failure, MapCost, Overheard, Runs
from panoloc_mcl.laboratory.corruptions import Recipe, corrupt, parse_recipe
from panoloc_mcl.laboratory.corruptions.recipe import CLEAN
from panoloc_mcl.laboratory.through import SeenThrough
from panoloc_mcl.robot.camera import Panorama, to_mapping
from panoloc_mcl.robot.errors import DatasetError, PanolocError
from panoloc_mcl.robot.files import cache_folder
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel, model_named
from panoloc_mcl.robot.source import source_digest
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets.references.thinning import thinned
from panoloc_mcl.tools.datasets.splice import teleports_of
from panoloc_mcl.tools.runs.map_cache import cached_map, cost_of_map
from panoloc_mcl.tools.runs.pipeline import Task, check_task, localize, make_tasks

# Parts that figures depend on, and those of them that change none.
_WITH_FIGURES = (
    "robot/",
    "tools/",
    "laboratory/comparison/cell.py",
    "laboratory/comparison/alone.py",
    "laboratory/corruptions/",
    "laboratory/peers/",
)
_WITHOUT_FIGURES = ("tools/cli/", "tools/report/")
_MAPS_KEPT = 4

# One cell at a time in a process: limits of BLAS hold for all of its threads.
_LOCK = Lock()


@dataclass(frozen=True, eq=False)
class Job:
    """A cell with the hashes of the data that it is meant for.

    Parameters
    ----------
    cell : Cell
    data : str
        Digest of references and sequences.
    key : str
        Digest of everything: names the cell's file.
    map : str
        Names the map that is needed: jobs with the same one can share it.
    """

    cell: Cell
    data: str
    key: str
    map: str


def make_job(cell: Cell, dataset: Dataset) -> Job:
    """Key a cell.

    Raises
    ------
    DatasetError
        Files of the data set, or the map, cannot be read.
    """
    recipe = parse_recipe(cell.condition["corruption"])
    data = data_digest(dataset, cell.config, whole=recipe.changes_data)
    settings = cell.config.model_dump(mode="json")
    # Where things lie and how many threads work changes no figure.
    for name in ("name", "dataset", "out"):
        settings.pop(name)
    settings["map"].pop("file")
    settings["localizer"]["monte_carlo"].pop("threads")
    description = {
        "format": FORMAT,
        "code": code_digest(),
        "config": settings,
        "corruption": cell.condition["corruption"],
        "references": cell.method["references"],
        "frames": cell.frames,
        "every": cell.every,
        "alone": cell.alone,
        "data": data,
    }
    key = hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()[:32]
    of_map = _key_of_map(cell, dataset)
    return Job(cell, data, key, json.dumps((of_map, recipe.text, cell.config.seed) if recipe.changes_data else of_map))


def code_digest() -> str:
    """Digest of all code of this package that figures can depend on: cells of other code are run again."""
    return source_digest(_WITH_FIGURES, _WITHOUT_FIGURES)


def data_digest(dataset: Dataset, config: RunConfig, whole: bool = False) -> str:
    """Digest of all data that a run reads: references, sequences (all of them if ``whole``), and the map file if there is one."""
    digest = hashlib.sha256(_references_digest(dataset).encode())
    for drive in dataset.select("all" if whole else config.sequences):
        digest.update(_drive_digest(drive).encode())
    if config.map.file is not None:
        digest.update(_content(config.map.file))
    return digest.hexdigest()


def prepare(job: Job) -> None:
    """Build the map that a job needs into the cache; what goes wrong is told when the job runs."""
    try:
        with _LOCK, threadpool_limits(1, user_api="blas"):
            _map(job, _as_recorded(job, _dataset(job.cell.config.dataset)))
    except Exception:
        return


def attempt(job: Job) -> Runs | Failure:
    """Run a job; whatever goes wrong becomes one line."""
    try:
        with _LOCK, threadpool_limits(1, user_api="blas"):
            return run_cell(job)
    except UnfitWorkerError as error:
        return Failure(str(error), unfit=True)
    except PanolocError as error:
        return Failure("; ".join(error.faults))
    except Exception as error:
        return Failure(" ".join(f"{type(error).__name__}: {error}".split()))


class UnfitWorkerError(DatasetError):
    """The data that a job is meant for are not here, or are others."""


def run_cell(job: Job) -> Runs:
    """Localize over the sequences of a cell.

    Raises
    ------
    UnfitWorkerError
        The data set is not here, or is another one.
    PanolocError
        As `panoloc_mcl.tools.runs.pipeline.run`.
    """
    config = job.cell.config
    dataset = _as_recorded(job, _checked_dataset(job))
    panorama_map, model, cost = _map(job, dataset)
    recipe = parse_recipe(job.cell.condition["corruption"])
    if recipe.changes_data:
        # Written into the data set already, all of it.
        recipe = parse_recipe(CLEAN)
    elif recipe.changes_images:
        model = cast(ObservationModel, _Disturbed(model, recipe, config.seed, panorama_map))
    if job.cell.alone:
        return look(dataset.select(config.sequences), panorama_map, model, cost)
    records = []
    overheard = Overheard()
    for task in make_tasks(dataset, config):
        check_task(task, panorama_map, config)
        shortened = _shortened(task, recipe, config.seed)
        record, _, _ = localize(shortened, 0, panorama_map, model, config, overheard)
        records.append(record)
    return Runs(tuple(records), panorama_map.references.positions, tuple(overheard.answers))


def _as_recorded(job: Job, dataset: Dataset) -> Dataset:
    """The data set with the drives as short as asked for, and with the imperfections of the cell, which are kept in the cache."""
    cell = job.cell
    wanted = {drive.name for drive in dataset.select(cell.config.sequences)}
    dataset = replace(
        dataset,
        sequences={name: _thinned(drive, cell) if name in wanted else drive for name, drive in dataset.sequences.items()},
    )
    recipe = parse_recipe(cell.condition["corruption"])
    if not recipe.changes_data:
        return dataset
    said = json.dumps(
        [code_digest(), job.data, recipe.text, cell.config.seed, sorted(wanted), cell.frames, cell.every, cell.alone]
    )
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", f"{dataset.name}-{recipe.text}")[:60]
    path = cache_folder() / "corrupted" / f"{name}-{hashlib.sha256(said.encode()).hexdigest()[:16]}"
    if not (path / "dataset.yaml").is_file():
        begun = path.with_name(f".{path.name}.{os.getpid()}")
        shutil.rmtree(begun, ignore_errors=True)
        corrupt(dataset, recipe, cell.config.seed, begun, sorted(wanted))
        try:
            begun.rename(path)
        except OSError:
            # Another process was faster.
            shutil.rmtree(begun, ignore_errors=True)
    return read_dataset(path)


def _thinned(drive: Drive, cell: Cell) -> Drive:
    # Single images do not begin with the first: drives may all begin at a reference.
    first = min(cell.every // 2, len(drive) - 1) if cell.alone else 0
    kept = slice(first, cell.frames, cell.every)
    return (
        drive if cell.frames is None and cell.every == 1 else replace(drive, times=drive.times[kept], files=drive.files[kept])
    )


def _checked_dataset(job: Job) -> Dataset:
    config = job.cell.config
    for last in (False, True):
        try:
            dataset = _dataset(config.dataset)
            if data_digest(dataset, config, parse_recipe(job.cell.condition["corruption"]).changes_data) == job.data:
                return dataset
            fault = f"{dataset.path}: holds other data than where the comparison was started; copy the data set here"
        except PanolocError as error:
            fault = "; ".join(error.faults)
        if last:
            raise UnfitWorkerError(fault)
        # A worker lives long: the data may have come after it first looked.
        forget_data()
    raise AssertionError("unreachable")


def forget_data() -> None:
    """Look at all files anew: they may have changed since the last comparison in this process."""
    _dataset.cache_clear()
    _content.cache_clear()


class _Disturbed(SeenThrough):
    """An observation model that sees corrupted panoramas. The same panorama is always corrupted in the same way, so that
    methods are compared on the same images."""

    def __init__(self, model: ObservationModel, recipe: Recipe, seed: int, panorama_map: PanoramaMap) -> None:
        super().__init__(model)
        self._recipe = recipe
        self._salt = (seed, zlib.crc32(recipe.text.encode()))
        self._elevation_deg = panorama_map.geometry.elevation_deg

    def seen(self, panorama: Panorama) -> Panorama:
        """Corrupted."""
        grey = np.clip(np.rint(panorama.pixels), 0.0, 255.0).astype(np.uint8)
        rng = np.random.default_rng((*self._salt, zlib.crc32(grey.tobytes())))
        return self._recipe.panorama(panorama, rng, self._elevation_deg)


def _shortened(task: Task, recipe: Recipe, seed: int) -> Task:
    """A drive without the frames that the recipe drops."""
    drive = task.drive
    count = len(drive)
    rng = np.random.default_rng((seed, zlib.crc32(recipe.text.encode()), zlib.crc32(drive.name.encode())))
    left = recipe.frames(count, rng)
    if len(left) == len(drive):
        return task
    if not len(left):
        raise DatasetError(f"sequence {drive.name}: no frame is left of {count}; drop fewer")
    return Task(drive.of(left), teleports_of(task.kidnapped, left))


@lru_cache(maxsize=16)
def _dataset(given: str) -> Dataset:
    return read_dataset(resolve_dataset(given))


@lru_cache(maxsize=100_000)
def _content(path: ImageSource) -> bytes:
    try:
        return hashlib.sha256(path.read_bytes() if isinstance(path, Path) else path.content()).digest()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror}); check the path and permissions") from error


def _references_digest(dataset: Dataset) -> str:
    references = dataset.references
    digest = hashlib.sha256(json.dumps(to_mapping(references.camera), sort_keys=True).encode())
    digest.update(references.poses.tobytes() + references.poses_of.encode())
    if references.sds is not None:
        digest.update(references.sds.tobytes())
    return _with_files(digest.hexdigest(), references.files)


def _drive_digest(drive: Drive) -> str:
    digest = hashlib.sha256(json.dumps([drive.name, to_mapping(drive.camera)], sort_keys=True).encode())
    digest.update(drive.times.tobytes())
    for trajectory in (drive.odometry, drive.groundtruth):
        digest.update(b"none" if trajectory is None else trajectory.times.tobytes() + trajectory.poses.tobytes())
    return _with_files(digest.hexdigest(), drive.files)


def _with_files(start: str, files: Sequence[ImageSource]) -> str:
    digest = hashlib.sha256(start.encode())
    for file in files:
        digest.update(file.name.encode() + _content(file))
    return digest.hexdigest()


MapKey = tuple[str, str, str, int]
_MAPS: dict[MapKey, tuple[PanoramaMap, ObservationModel, MapCost]] = {}


def _key_of_map(cell: Cell, dataset: Dataset) -> MapKey:
    config = cell.config
    source = _references_digest(dataset) if config.map.file is None else _content(config.map.file).hex()
    seed = config.seed if model_named(config.observation.model).draws else 0
    return source, cell.method["references"], config.observation.model_dump_json() + config.map.model_dump_json(), seed


def _map(job: Job, dataset: Dataset) -> tuple[PanoramaMap, ObservationModel, MapCost]:
    """The map that a job needs and its cost; the last few are kept in memory, all of them in the cache of files."""
    key = _key_of_map(job.cell, dataset)
    if key not in _MAPS:
        while len(_MAPS) >= _MAPS_KEPT:
            _MAPS.pop(next(iter(_MAPS)))
        config = job.cell.config
        if config.map.file is not None:
            panorama_map = PanoramaMap.load(config.map.file)
            cost = MapCost(float("nan"), config.map.file.stat().st_size / 1e6)
        else:
            used = replace(dataset, references=thinned(dataset.references, job.cell.method["references"]))
            panorama_map = cached_map(used, config.observation, config.seed, settings=config.map)
            cost = MapCost(*cost_of_map(used, config.observation, config.seed, config.map))
        _MAPS[key] = panorama_map, panorama_map.observation_model(config.observation), cost
    return _MAPS[key]

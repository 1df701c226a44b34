"""Whether claimed covariances hold: errors against what single images and the filter claim, where the world is as modelled and not."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.corruptions import Recipe, parse_recipe
from panoloc_mcl.laboratory.corruptions.dataset import corrupt
from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.laboratory.studies.claims import Claims, kept
from panoloc_mcl.laboratory.through import SeenThrough
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.evaluation.record import group_of
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import answers, recorded

_TheMap = Callable[[], tuple[PanoramaMap, ObservationModel]]

# Of images of a robot that stands: a good camera's noise, grey levels, and the time between them, seconds.
_NOISE, _PERIOD_S = 2.0, 0.5
# Of a drive, so many images that are taken while standing, at three places at the least: all images of a place err alike.
_LOOKS, _FEWEST_PLACES = 80, 3


@dataclass(frozen=True)
class Condition:
    """A row of the table.

    Parameters
    ----------
    name : str
    references : str
        Recipe of what the map is made from.
    images : str
        Recipe of what is localized.
    standing : int
        So many images are taken from one place; 0: the drives as they are.
    by_light : bool
        A row for every group of drives.
    mended : bool
        Whether the map mends the poses of its references.
    surveyed : bool
        Whether the errors of the references are drawn, so that all images over one map share one draw.
    """

    name: str
    references: str = "clean"
    images: str = "clean"
    standing: int = 0
    by_light: bool = False
    mended: bool = True
    surveyed: bool = False


CONDITIONS = (
    Condition("as it is", by_light=True),
    *(Condition(f"camera tilted by {degrees}°", images=f"tilt:{degrees}") for degrees in (1, 2, 4)),
    Condition("30 % of the columns hidden", images="bars:0.3"),
    *(Condition(f"gain {gain:g}", images=f"gain:{gain:g}") for gain in (0.35, 2.2)),
    Condition("standing, 16 images", standing=16),
    Condition("standing, 200 images", standing=200),
    Condition("standing, tilted by 2°, 16 images", images="lean:1.6,roll_deg=1.2", standing=16),
    Condition("standing, tilted by 2°, 200 images", images="lean:1.6,roll_deg=1.2", standing=200),
    Condition("references tilted by 2°", "mount_tilt:mild,degrees=2,where=references"),
    *(
        Condition(f"references' poses off by {off}, {what}", f"pose_noise:mild,{values}", mended=mended, surveyed=True)
        for off, values in (("2 cm, 1°", "xy_m=0.02,theta_deg=1"), ("5 cm, 2°", "xy_m=0.05,theta_deg=2"))
        for what, mended in (("as given", False), ("mended", True))
    ),
    Condition("camera's height off by 5 cm", "height:mild,metres=0.05"),
)

_HEADS = (
    "condition",
    "surveys",
    "drives",
    "images",
    "one image: mm, median",
    "NEES",
    "within 2 sd, %",
    "heading NEES",
    "heading within 2 sd, %",
    "filter: mm, median",
    "filter: NEES",
    "filter: within 2 sd, %",
    "filter: heading NEES",
    "filter: heading within 2 sd, %",
)


def study(
    config: RunConfig,
    every: int = 1,
    rows: Sequence[str] = ("*",),
    progress: Progress = no_progress,
    keep: Callable[[Report], None] = lambda report: None,
    also: Sequence[str] = (),
    most_drives: int | None = None,
    cells: Path | None = None,
    surveys: int = 4,
) -> Report:
    """Hold errors against claims, condition by condition.

    Parameters
    ----------
    config : RunConfig
        ``dataset``, ``observation``, ``localizer``, ``sequences`` and ``seed``.
    every : int
        Use every so many images of a drive.
    rows : sequence of str
        Names or patterns of conditions.
    progress : callable (done, total, what)
    keep : callable
        Called with the report after each condition.
    also : sequence of str
        Other data sets that are taken as they are.
    most_drives : int, optional
        So many drives at most, evenly over all, where a condition has no row for every light.
    cells : Path, optional
        Folder where each drive of each condition is kept: what is there is not run again.
    surveys : int
        So many surveys are drawn where poses of references are off, with seeds of their own from ``seed`` on, and the drives are
        spread over them: the error of a map's frame is common to all of its images, however many there are.

    Raises
    ------
    ConfigError
        No condition has such a name.
    """
    chosen = [condition for condition in CONDITIONS if any(fnmatchcase(condition.name, row) for row in rows)]
    if not chosen:
        raise ConfigError(f"--rows {' '.join(rows)}: no such condition; known: {', '.join(one.name for one in CONDITIONS)}")
    sets = [_selected(config.dataset, config.sequences, every), *(_selected(name, "all", every) for name in also)]
    names = " and ".join(f"`{dataset.name}`" for dataset, _ in sets)
    report = Report(
        f"Claims of {names}, seed {config.seed}, every {every}. image: error against claimed covariance, of single images "
        "(nothing known) and of the filter where it is sure. NEES: median over that of the chi-squared distribution, 1 is right, more "
        "is too sure; within 2 sd: right are 86.5 % for the position and 95.4 % for the heading. Images of a drive err alike, so the "
        "drives are what counts; where poses of references are drawn, so do all images of a survey, and the surveys are what counts."
    )
    table = report.table("", _HEADS)
    by_survey = report.table("By survey", _HEADS) if any(condition.surveyed for condition in chosen) else None
    work = [(condition, *sets[0]) for condition in chosen]
    work += [(condition, *others) for others in sets[1:] for condition in chosen if condition.by_light]
    maps = _Maps(progress)
    with threadpool_limits(1):
        for done, (condition, dataset, drives) in enumerate(work):
            of_rows: dict[str, Claims] = {}
            of_surveys: dict[int, Claims] = {}
            some = drives if condition.by_light else _spread(drives, most_drives)
            for survey, drive in _shared_out(some, surveys if condition.surveyed else 1):
                drawn = config.model_copy(update={"seed": config.seed + survey})
                # Which drives are asked for does not change what one of them gives.
                settings = drawn.model_dump_json(include={"observation", "localizer", "map", "seed"})
                compute = partial(_claims, condition, drawn, drive, partial(maps.of, drawn, dataset, condition))
                claims = kept(cells, (condition, dataset.path, drive.name, every, settings), compute)
                of_rows.setdefault(_row(condition, dataset, drive), Claims()).add(claims)
                of_surveys.setdefault(survey, Claims()).add(claims)
            for name, claims in of_rows.items():
                table.add(name, len(of_surveys) if condition.surveyed else None, *claims.cells())
            if condition.surveyed and by_survey is not None:
                for survey, claims in of_surveys.items():
                    by_survey.add(f"{condition.name}, seed {config.seed + survey}", 1, *claims.cells())
            keep(report)
            progress(done + 1, len(work), "conditions")
    return report


def _selected(name: str, sequences: str | Sequence[str], every: int) -> tuple[Dataset, list[Drive]]:
    """A data set, and its drives that have ground truth."""
    dataset = read_dataset(resolve_dataset(name))
    drives = [drive for drive in dataset.select(sequences) if drive.groundtruth is not None]
    if not drives:
        raise ConfigError(f"{dataset.path}: has no sequence with ground truth among those selected; use another data set")
    return dataset, [replace(drive, times=drive.times[::every], files=drive.files[::every]) for drive in drives]


def _spread(drives: Sequence[Drive], most: int | None) -> list[Drive]:
    """So many at most, evenly over all: of drives that are named by their light, of every light."""
    if most is None or most >= len(drives):
        return list(drives)
    return [drives[round(index)] for index in np.linspace(0, len(drives) - 1, most)]


def _shared_out(drives: Sequence[Drive], surveys: int) -> list[tuple[int, Drive]]:
    """Surveys and the drives that are localized in the maps of each, survey by survey: every survey and every drive at least once."""
    count = max(surveys, len(drives))
    return sorted(((turn % surveys, drives[turn % len(drives)]) for turn in range(count)), key=lambda pair: pair[0])


def _row(condition: Condition, dataset: Dataset, drive: Drive) -> str:
    return f"{dataset.name}, {condition.name}, {group_of(drive.name)}" if condition.by_light else condition.name


class _Maps:
    """Maps of references that are as good as conditions say: one at a time, as they are large."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._key: tuple[object, ...] = ()
        self._last: tuple[PanoramaMap, ObservationModel] | None = None

    def of(self, config: RunConfig, dataset: Dataset, condition: Condition) -> tuple[PanoramaMap, ObservationModel]:
        """The last one, if it is asked for again."""
        key = dataset.name, condition.references, condition.mended, config.seed
        if self._last is None or key != self._key:
            self._last = None
            self._key, self._last = key, _map(config, dataset, condition, self._progress)
        return self._last


def _map(config: RunConfig, dataset: Dataset, condition: Condition, progress: Progress) -> tuple[PanoramaMap, ObservationModel]:
    """The map of references that are as good as a condition says."""
    parsed = parse_recipe(condition.references)
    settings = config.map.model_copy(update={"mend": config.map.mend and condition.mended})
    if parsed.changes_data:
        with tempfile.TemporaryDirectory() as folder:
            # A data set needs a drive; this one is not localized over.
            name, drive = next(iter(dataset.sequences.items()))
            short = replace(drive, times=drive.times[:2], files=drive.files[:2])
            written = corrupt(replace(dataset, sequences={name: short}), parsed, config.seed, Path(folder) / "data", [name])
            panorama_map = cached_map(read_dataset(written), config.observation, config.seed, progress, settings)
    else:
        panorama_map = cached_map(dataset, config.observation, config.seed, progress, settings)
    return panorama_map, panorama_map.observation_model(config.observation)


def _claims(condition: Condition, config: RunConfig, drive: Drive, the_map: _TheMap) -> Claims:
    """Of one drive."""
    panorama_map, model = the_map()
    claims = Claims()
    # A single image is looked for all over the map, whatever is known.
    searching = config.model_copy(update={"localizer": config.localizer.model_copy(update={"tracking": False})})
    recipe = f"{condition.images}+noise:{_NOISE:g}" if condition.standing else condition.images
    parsed = parse_recipe(recipe.removeprefix("clean+"))
    seed = (config.seed, zlib.crc32(drive.name.encode()))
    for number, way in enumerate(_standing(drive, condition.standing) if condition.standing else [drive]):
        localizer = Localizer(
            panorama_map,
            searching,
            camera=drive.camera,
            image_size=drive.image_size,
            seed=(*seed, number),
            model=cast(ObservationModel, _Through(model, parsed, (*seed, number), panorama_map)),
        )
        assert way.groundtruth is not None
        for _, estimate in answers(localizer, recorded(way)):
            claims.take(drive.name, estimate, way.groundtruth.at(estimate.timestamp))
    return claims


class _Through(SeenThrough):
    """A model that sees images as a recipe has them, each with random numbers of its own."""

    def __init__(self, model: ObservationModel, recipe: Recipe, seed: tuple[int, ...], panorama_map: PanoramaMap) -> None:
        super().__init__(model)
        self._recipe, self._seed, self._count = recipe, seed, 0
        self._elevation_deg = panorama_map.geometry.elevation_deg

    def seen(self, panorama: Panorama) -> Panorama:
        """As the recipe has it."""
        self._count += 1
        if not self._recipe.changes_images:
            return panorama
        return self._recipe.panorama(panorama, np.random.default_rng((*self._seed, self._count)), self._elevation_deg)


def _standing(drive: Drive, images: int) -> Iterator[Drive]:
    """A robot that stands, and looks so many times, at several places of a drive."""
    assert drive.groundtruth is not None
    places = max(_FEWEST_PLACES, _LOOKS // images)
    for place in range(places):
        index = (2 * place + 1) * len(drive) // (2 * places)
        times = drive.times[index] + _PERIOD_S * np.arange(images)
        pose = drive.groundtruth.at(drive.times[index])
        standing = Trajectory(times, np.tile(pose, (images, 1)))
        yield replace(drive, times=times, files=(drive.files[index],) * images, odometry=standing, groundtruth=standing)

"""What errors of a camera's description cost, and what is left of that once ``panoloc calibrate`` has found them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.corruptions.dataset import corrupt
from panoloc_mcl.laboratory.corruptions.scenery import Body
from panoloc_mcl.laboratory.corruptions.sight import sight_of
from panoloc_mcl.laboratory.reports import Number, Report, Table
from panoloc_mcl.laboratory.simulation.settings import SimulationConfig
from panoloc_mcl.laboratory.simulation.simulate import Simulation
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.validation import dump_yaml, read_yaml, validate
from panoloc_mcl.tools.calibration.calibrate import Findings, calibrate, table_of
from panoloc_mcl.tools.calibration.written import write_camera
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.evaluation import evaluate
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.runs.pipeline import localize, make_tasks


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Parameters
    ----------
    name : str
    recipe : str
        What is wrong with the data set, as `panoloc corrupt` says it.
    raw : bool
        It is of raw images: a data set whose drives are those of a mirror.
    found : bool
        Whether the camera is calibrated, so that there is an "after".
    metres : float
        Calibrate with the beginning of one drive, so long; 0: with all of them.
    """

    name: str
    recipe: str
    raw: bool = False
    found: bool = True
    metres: float = 0.0


_MOUNT = "turned:strong+mount_yaw:strong+mount_tilt:mild,degrees=2,towards_deg=0"
CASES = (
    Case("as it is", "clean", found=False),
    Case("body with a strut of 8°", "body:mild"),
    Case("body with a strut of 20°, references at any heading", "turned:strong+body:strong"),
    Case("no body, references at any heading", "turned:strong"),
    Case("mounted 15 cm ahead, 5 cm left, yaw 20°, pitch 2°: given", f"{_MOUNT}+told", found=False),
    Case("the same mount, found from 5 m of one drive", _MOUNT, metres=5.0),
    Case("elevations of the drives 5 % too large", "elevation_scale:mild,scale=1.05"),
    Case("elevations of the drives 3° too high", "elevation_shift:strong"),
    Case("height 10 cm too large", "height:strong"),
    Case("raw mirror images as they are", "clean", raw=True, found=False),
    Case("mirror's centre 3 px off", "centre:mild,pixels=3", raw=True),
    Case("mirror's focal length 3 % too long", "focal:mild,scale=1.03", raw=True),
)

# Of the cylinder's resolution once they are panoramas, a pixel a degree across and two down; fisheyes of 190 degrees side by side.
_LENS = {"kind": "kannala_brandt", "fx": 114.6, "fy": 114.6, "cx": 191.5, "cy": 191.5}
_SPHERE = {"kind": "equirectangular", "height_m": 0.6, "size": [360, 360]}
_PAIR = {"kind": "fisheye_pair", "height_m": 0.6, "front": {"lens": _LENS}, "back": {"lens": _LENS, "offset_px": [384, 0]}}
#: Cameras that the simulator takes the same drives with: name, camera, size of its images.
CAMERAS: tuple[tuple[str, dict[str, Any], tuple[int, int]], ...] = (
    ("cylinder, -50 to 25°", {"kind": "panorama", "elevation_deg": [-50, 25], "height_m": 0.6}, (360, 150)),
    ("full sphere", _SPHERE, (720, 360)),
    ("full sphere, -50 to 25° used", {**_SPHERE, "elevation_deg": [-50, 25], "size": [360, 150]}, (720, 360)),
    ("two fisheyes", _PAIR, (768, 384)),
)

_FIGURES = ("mm, median / p95", "heading, median / p95, °", "sure and wrong")
_HEADS = ("case", "drives", "images", *(f"before: {head}" for head in _FIGURES), *(f"after: {head}" for head in _FIGURES))
_BLANK = (None,) * len(_FIGURES)


@dataclass(frozen=True)
class _Ask:
    """What every row is asked with."""

    config: RunConfig
    every: int
    folder: Path
    progress: Progress

    def map_of(self, dataset: Dataset) -> PanoramaMap:
        """Of the references of a data set."""
        return cached_map(dataset, self.config.observation, self.config.seed, self.progress, self.config.map)


def study(
    config: RunConfig,
    raw: str | None = None,
    every: int = 1,
    rows: Sequence[str] = ("*",),
    folder: Path | None = None,
    progress: Progress = no_progress,
    keep: Callable[[Report], None] = lambda report: None,
) -> Report:
    """Disturb a data set, localize, calibrate, localize again.

    Parameters
    ----------
    config : RunConfig
        ``dataset``, ``observation``, ``map``, ``localizer``, ``sequences`` and ``seed``.
    raw : str, optional
        A data set of raw mirror images, for the rows that are about them; these are left out without it.
    every : int
        Localize over every so many images of a drive. Calibrated is with all of them.
    rows : sequence of str
        Names or patterns of cases.
    folder : Path, optional
        Keeps the data sets that are made, with what calibrating them found, and uses those that are there.
    progress : callable (done, total, what)
    keep : callable
        Called with the report after each case.

    Raises
    ------
    ConfigError
        No case has such a name.
    """
    cases = [case for case in CASES if any(fnmatchcase(case.name, row) for row in rows) and (raw or not case.raw)]
    cameras = [camera for camera in CAMERAS if any(fnmatchcase(camera[0], row) for row in rows)]
    if not cases and not cameras:
        known = ", ".join([*(case.name for case in CASES), *(name for name, *_ in CAMERAS)])
        raise ConfigError(f"--rows {' '.join(rows)}: no such case; known: {known}")
    report = Report(
        f"Cameras described wrongly, before and after `panoloc calibrate`; every {every}. image, seed {config.seed}."
    )
    table = report.table("", _HEADS) if cases else Table("", _HEADS)
    masks = Table("Masks that were found", ("case", "robot found, % of it", "world lost, % of it", "robot in the image, %"))
    values = Table("What was found", ("case", "unknown", "before", "after", "standard deviation"))
    with tempfile.TemporaryDirectory() as made:
        ask = _Ask(config, every, Path(made) if folder is None else folder, progress)
        for case in cases:
            _row(ask, case, raw if case.raw and raw else config.dataset, table, masks, values)
            report.tables = [table, *(part for part in (masks, values) if part.rows)]
            keep(report)
        if cameras:
            seen = report.table("The same drives through other cameras", ("camera", "drives", "images", *_FIGURES))
            for name, camera, size in cameras:
                seen.add(name, *_judged(ask, read_dataset(_simulated(ask, name, camera, size))))
                keep(report)
    return report


def _row(ask: _Ask, case: Case, source: str, table: Table, masks: Table, values: Table) -> None:
    dataset = read_dataset(resolve_dataset(source))
    path = ask.folder / _file_name(case.name)
    wanted = ask.config.sequences if not case.raw else "all"
    recipe = parse_recipe(case.recipe)
    if not path.is_dir():
        corrupt(dataset, recipe, ask.config.seed, path, wanted, ask.progress)
    given = read_dataset(path)
    before = _judged(ask, given)
    if not case.found:
        table.add(case.name, *before, *_BLANK)
        return
    drives = _beginning(given, case.metres) if case.metres else None
    found = calibrate(given, None, drives, ask.progress, ask.map_of(given))
    table.add(case.name, *before, *_judged(ask, read_dataset(_with_camera(path, found)))[2:])
    for name, *cells in table_of(found):
        values.add(case.name, name, *cells)
    if found.body is not None:
        bodies = [use.settings for use in recipe.uses if isinstance(use.settings, Body)]
        size = given.references.image_size if not found.of_drives else next(iter(given.sequences.values())).image_size
        hidden = bodies[0].hides(sight_of(found.before, size)) if bodies else np.zeros(size[::-1], dtype=np.bool_)
        masks.add(case.name, *_held(found.body.world, hidden))


def _held(world: NDArray[np.bool_], hidden: NDArray[np.bool_]) -> tuple[Number, ...]:
    """Of a found mask: share of the robot that it covers, share of the world that it covers, share of the robot in the image."""
    shares = (float(np.mean(~world[hidden])) if hidden.any() else None, float(np.mean(~world[~hidden])), float(hidden.mean()))
    return tuple(Number(None if share is None else 100.0 * share, 1) for share in shares)


def _judged(ask: _Ask, dataset: Dataset) -> tuple[Any, ...]:
    """Drives, images and figures of a run, as `panoloc run` makes them."""
    config = ask.config
    panorama_map = ask.map_of(dataset)
    model = panorama_map.observation_model(config.observation)
    tasks = make_tasks(dataset, config.model_copy(update={"sequences": "all"}))
    records = []
    for done, task in enumerate(tasks):
        drive, every = task.drive, slice(None, None, ask.every)
        thinned = replace(
            task, drive=replace(drive, times=drive.times[every], files=drive.files[every]), kidnapped=task.kidnapped[every]
        )
        records.append(localize(thinned, 0, panorama_map, model, config)[0])
        ask.progress(done + 1, len(tasks), "drives")
    found = evaluate(records, panorama_map.references.positions)["overall"]
    metres = [found[key] for key in ("position_median_m", "position_p95_m")]
    wrong = found["false_convergence"]
    return (
        len(records),
        found["frames"],
        " / ".join(Number(None if one is None else 1000.0 * one, 1).text() for one in metres),
        " / ".join(Number(found[key], 3).text() for key in ("heading_median_deg", "heading_p95_deg")),
        f"{wrong['count']} of {wrong['runs']}",
    )


def _beginning(dataset: Dataset, metres: float) -> list[Drive]:
    """The first so many metres of the first drive, by its odometry."""
    drive = next(iter(dataset.sequences.values()))
    if drive.odometry is None:
        raise ConfigError(f"{drive.path}: has no odometry; the way cannot be told")
    at = drive.odometry.at(drive.times)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(at[:, :2], axis=0).T))])
    count = int((way <= metres).sum())
    return [replace(drive, times=drive.times[:count], files=drive.files[:count])]


def _with_camera(path: Path, found: Findings) -> Path:
    """A copy of a data set that is described as it was found."""
    copy = path.with_name(f"{path.name}_calibrated")
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(path, copy)
    if found.of_drives:
        for drive in (copy / "sequences").iterdir():
            write_camera(found, drive / "camera.yaml")
        return copy
    write_camera(found, copy / "camera.yaml")
    data = read_yaml(copy / "dataset.yaml")
    write_atomically(copy / "dataset.yaml", dump_yaml({**data, "camera": {"file": "camera.yaml"}}))
    return copy


def _simulated(ask: _Ask, name: str, camera: dict[str, Any], size: tuple[int, int]) -> Path:
    """The hall as a camera sees it: references at noon, two drives in each light."""
    path = ask.folder / _file_name(name)
    if not (path / "dataset.yaml").is_file():
        lights = ("noon", "afternoon", "evening")
        drives = [
            {"name": f"{light}_{n:02d}", "light": light, "frames": 40, "every_s": 1.25} for light in lights for n in range(2)
        ]
        said = {
            "name": "hall",
            "scene": "hall",
            "seed": 1,
            "references_light": "noon",
            "sequences": drives,
            "sensor": {"samples": 2},
        }
        settings = validate(SimulationConfig, {**said, "camera": camera, "size": size}, f"camera '{name}'")
        Simulation(settings, path.parent).run(path, ask.progress, lambda text: None)
    return path


def _file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name)

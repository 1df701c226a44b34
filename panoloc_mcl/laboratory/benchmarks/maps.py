"""Maps: building one, and the cost of an image against the number of places and of headings."""

from __future__ import annotations

import importlib
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from panoloc_mcl.laboratory.benchmarks.speed import localizer_step
from panoloc_mcl.laboratory.comparison.summaries.plots import save_png
from panoloc_mcl.laboratory.reports import Number, Ratio, Report
from panoloc_mcl.laboratory.timing import in_a_process, interleaved, matrix_product
from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import Places, VotesModel
from panoloc_mcl.robot.references import ReferencePanoramas, read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import virtual_positions
from panoloc_mcl.robot.synthesis.views import FloorRays
from panoloc_mcl.tools.config import RunConfig, config_from_mapping
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image, resolve_dataset

COMPONENTS = 60
# What the default rule gives to 1600 places and more.
COMPONENTS_OF_MANY = 200
TILES = (1, 7, 27)
COLUMNS = (90, 180, 360, 720)
_GAP_M = 2.0
_ROUNDS = 9


def settings(components: int = COMPONENTS, **more: object) -> RunConfig:
    """The default with so many eigenimages, on one thread."""
    virtual = {"threads": 1, **more}
    return config_from_mapping({"observation": {"votes": {"components": components, "virtual_places": virtual}}})


def building(dataset: str, repeats: int, peer: str | None = None) -> Report:
    """Time, memory and size of a map.

    Parameters
    ----------
    dataset : str
    repeats : int
    peer : str, optional
        ``module:function`` that builds the same another way, to be timed beside it: it takes references, floor rays, positions of the
        places, settings and the number of eigenimages, as ``oracles.building:build`` of the tests does in plain NumPy.
    """
    data = read_dataset(resolve_dataset(dataset))
    references = read_references(data.references)
    calibrated = settings().observation.votes
    plain = calibrated.model_copy(update={"calibration_references": 0})
    # It calibrates nothing.
    others = {} if peer is None else {peer: _peer(peer, references, plain)}
    # Kernels are compiled before anything is timed.
    VotesModel.build(references.of(np.arange(2)), settings(2, spacing_m=0.5).observation.votes)
    product, _ = matrix_product()
    builds: dict[str, Callable[[], object]] = {
        "depths, views and eigenspace": lambda: VotesModel.build(references, plain),
        "the same with the calibration on held-out references": lambda: VotesModel.build(references, calibrated),
        "matrix product 1024 x 1024, float32": product,
        **others,
    }
    spent = interleaved(builds, repeats, warm_up=0)
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "map")
        built = in_a_process(f"{__name__}:build_and_save", str(data.path), path)
        loaded = in_a_process(f"{__name__}:load", path)
    report = Report(
        f"Building the map of `{data.name}`: {len(references)} references, {built['places']:.0f} places, p = {COMPONENTS}; one thread, "
        f"{repeats} rounds in turns, processor time."
    )
    table = report.table("", ("what", "seconds", "time / the first (95 %)"))
    base = next(iter(spent.values())).processor
    for name, times in spent.items():
        table.add(name, Number(float(np.median(times.processor)), 3), Ratio.of(times.processor, base))
    table = report.table("The map", ("what", "figure"))
    table.add("peak memory of a process that reads the data set, builds and saves, MB", Number(built["peak_mb"]))
    table.add("map file, MB", Number(built["file_mb"], 1))
    table.add("load the map and make its observation model, s", Number(loaded["seconds"], 3))
    return report


def _peer(name: str, references: ReferencePanoramas, votes: VotesSettings) -> Callable[[], object]:
    module, _, function = name.partition(":")
    try:
        build = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"--peer {name}: cannot be imported ({error}); write MODULE:FUNCTION of one on PYTHONPATH") from error
    if references.camera_height_m is None:
        raise ConfigError(f"--peer {name}: needs the camera's height; add camera.height_m to dataset.yaml")
    rays = FloorRays.of(references.geometry, references.camera_height_m)
    positions = virtual_positions(references.positions, Places(references.positions).spacing, votes.virtual_places)
    return lambda: build(references, rays, positions, votes, COMPONENTS)


def build_and_save(dataset: str, path: str) -> dict[str, float]:
    """Build and save the map of a data set."""
    config = settings()
    built = PanoramaMap.build(read_dataset(dataset), config.observation)
    built.save(path)
    places = len(built.observation_model().places)
    return {"places": places, "file_mb": Path(path).stat().st_size / 1e6}


def load(path: str) -> dict[str, float]:
    """Load a map and make its observation model."""
    begin = time.perf_counter()
    PanoramaMap.load(path).observation_model()
    return {"seconds": time.perf_counter() - begin}


def tiled(small: PanoramaMap, tiles: int) -> PanoramaMap:
    """A map of many places: one map several times side by side, so that its images are as many as those of a map so large."""
    references = small.references
    model = small.observation_model()
    extent = np.ptp(model.places.positions, axis=0) + _GAP_M
    spacing = model.places.spacing
    extent = np.ceil(extent / spacing) * spacing
    across = int(np.ceil(np.sqrt(tiles)))
    offsets = np.array([(index % across, index // across) for index in range(tiles)]) * extent
    positions = (references.positions[None] + offsets[:, None]).reshape(-1, 2)
    names = tuple(f"{tile}_{name}" for tile in range(tiles) for name in references.names)
    many = replace(references.of(np.tile(np.arange(len(references)), tiles)), positions=positions, names=names)
    arrays = dict(small.arrays)
    of_references = {"profiles", "alone"} & set(arrays)
    arrays.update({name: np.concatenate([arrays[name]] * tiles) for name in of_references})
    arrays["used"] = np.concatenate([arrays["used"] + tile * len(references) for tile in range(tiles)])
    # In the order in which the map lays out its places.
    probe = VotesModel.restore(many, small.observation.votes, arrays).places.positions
    tile = np.argmin([np.abs(probe - offset - model.places.positions.mean(axis=0)).max(axis=1) for offset in offsets], axis=0)
    source = model.places.nearest(probe - offsets[tile])
    for name, array in small.arrays.items():
        if name not in {*of_references, "spectra_real", "spectra_imaginary", "used"} and len(array) == len(model.places):
            arrays[name] = array[source]
    surveyed = Keyframes.surveyed(names, np.pad(positions, ((0, 0), (0, 1))))
    return replace(small, references=many, keyframes=surveyed, arrays=arrays)


def images_of(panorama_map: PanoramaMap, path: str) -> dict[str, float]:
    """Median processor seconds of an image: vote field only, and from pixels to pose, particle filter included."""
    dataset = read_dataset(Path(path))
    drive = next(iter(dataset.sequences.values()))
    images = [read_image(file) for file in drive.files[:6]]
    observation = panorama_map.observation
    field = panorama_map.observation_model(observation.model_copy(update={"votes": unrefined(observation.votes)}))
    panoramas = [panorama_map.unwrapper(drive.camera, drive.image_size)(image) for image in images]
    number = count()
    step = localizer_step(panorama_map, RunConfig(observation=observation), images)
    medians = processor_time({"field": lambda: field.observe(panoramas[next(number) % len(panoramas)]), "pose": step})
    return {"places": len(field.places), "references": len(panorama_map.references), **medians}


def unrefined(votes: VotesSettings) -> VotesSettings:
    """The same without refinement."""
    return votes.model_copy(update={"refinement": votes.refinement.model_copy(update={"enabled": False})})


def processor_time(tasks: Mapping[str, Callable[[], object]]) -> dict[str, float]:
    """Median seconds of the processor for each task: these are compared over processes, on a machine that may be busy."""
    return {name: float(np.median(spent.processor)) for name, spent in interleaved(tasks, _ROUNDS).items()}


def image_of_many(path: str, dataset: str) -> dict[str, float]:
    """One image against the map in a file."""
    return images_of(PanoramaMap.load(path), dataset)


def costs(dataset: str, out: Path | None = None) -> Report:
    """Time of an image against the number of places, and of headings; with ``out`` also as a picture, ``costs.png`` there."""
    data = read_dataset(resolve_dataset(dataset))
    report = Report(
        f"Cost of one image of `{data.name}`, one thread, processor time, medians of {_ROUNDS}. The vote field is without refinement; "
        "pixels to pose is all of it, particle filter included."
    )
    heads = (
        "places",
        "references",
        "p",
        "vote field, ms",
        "pixels to pose, ms",
        "images a second",
        "peak memory, MB",
        "map file, MB",
    )
    note = (
        "More places than the map has are the map several times side by side (tiles): as large as a real one, but alike. Memory is the "
        "peak of a process that loads the map and localizes."
    )
    table = report.table("Against the number of places", heads, note)
    by_places = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map"
        for components, make in _maps(data):
            make().save(path)
            found = in_a_process(f"{__name__}:image_of_many", str(path), str(data.path))
            by_places.append((found["places"], found["field"], found["pose"]))
            table.add(
                *(int(found["places"]), int(found["references"]), components),
                *(Number(1e3 * found["field"], 1), Number(1e3 * found["pose"], 1), Number(1.0 / found["pose"], 1)),
                *(Number(found["peak_mb"]), Number(path.stat().st_size / 1e6)),
            )
    note = f"Panoramas resized to other widths; virtual places by the map's rule, p = {COMPONENTS}."
    table = report.table("Against the number of headings", ("headings", "vote field, ms", "with refinement, ms"), note)
    by_headings = [(columns, *heading_cost(data, columns)) for columns in COLUMNS]
    for columns, field, refined in by_headings:
        table.add(columns, Number(1e3 * field, 1), Number(1e3 * refined, 1))
    if out is not None:
        plot(by_places, by_headings, out / "costs.png")
    return report


def _maps(data: Dataset) -> list[tuple[int, Callable[[], PanoramaMap]]]:
    """Numbers of eigenimages, and maps of more and more places."""
    count = len(data.references)
    many = PanoramaMap.build(data, settings(COMPONENTS_OF_MANY).observation)
    return [
        (count, lambda: PanoramaMap.build(data, settings(count, enabled=False).observation)),
        (COMPONENTS, lambda: PanoramaMap.build(data, settings().observation)),
        *((COMPONENTS_OF_MANY, lambda tiles=tiles: tiled(many, tiles)) for tiles in TILES),
    ]


def heading_cost(dataset: Dataset, columns: int) -> tuple[float, float]:
    """Median seconds of an image of another width: vote field, and with the refinement."""
    references = read_references(dataset.references)

    def resized(image: Any) -> Any:
        kind = cv2.INTER_AREA if columns < image.shape[1] else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (columns, image.shape[0]), interpolation=kind))

    geometry = references.geometry
    other = replace(
        references,
        pixels=np.stack([resized(image) for image in references.pixels]),
        valid=None if references.valid is None else np.stack([resized(seen.astype(np.uint8)) > 0 for seen in references.valid]),
        geometry=PanoramaGeometry(columns, geometry.height, geometry.elevation_bottom_deg, geometry.elevation_top_deg),
    )
    votes = settings().observation.votes
    model = VotesModel.build(other, votes)
    field = VotesModel.restore(other, unrefined(votes), model.arrays())
    drive = next(iter(dataset.sequences.values()))
    image = Panorama(resized(read_image(drive.files[0])).astype(np.float32), None)
    medians = processor_time({"field": lambda: field.observe(image), "refined": lambda: model.observe(image)})
    return medians["field"], medians["refined"]


def plot(by_places: Sequence[Sequence[float]], by_headings: Sequence[Sequence[float]], path: Path) -> None:
    """Both tables as one picture; needs the extra plot."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    axes = figure.subplots(1, 2)
    for axis, table, label, second in (
        (axes[0], np.array(by_places), "places", "pixels to pose"),
        (axes[1], np.array(by_headings), "headings", "with refinement"),
    ):
        table = table[np.argsort(table[:, 0], kind="stable")]
        axis.loglog(table[:, 0], 1e3 * table[:, 1], "o-", label="vote field")
        axis.loglog(table[:, 0], 1e3 * table[:, 2], "s--", label=second)
        axis.set_xlabel(label)
        axis.set_xticks(np.unique(table[:, 0]), [f"{value:.0f}" for value in np.unique(table[:, 0])])
        axis.xaxis.set_minor_locator(NullLocator())
        axis.set_ylabel("ms an image, one thread")
        axis.grid(True, which="both", alpha=0.3)
        axis.legend()
    save_png(figure, path)

"""Sections of ``benchmark.py`` on maps: building one against plain NumPy, and the cost against the number of places and headings."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.references import ReferencePanoramas, read_references
from panoloc_mcl.tools.config import RunConfig, config_from_mapping
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image

COMPONENTS = 60
# What the default rule gives to 1600 places and more.
COMPONENTS_OF_MANY = 200
TILES = (1, 7, 27)
COLUMNS = (90, 180, 360, 720)
_GAP_M = 2.0


def settings(components: int = COMPONENTS, **more: object) -> RunConfig:
    """The default with so many eigenimages, on one thread."""
    virtual = {"threads": 1, **more}
    return config_from_mapping({"observation": {"votes": {"components": components, "virtual_places": virtual}}})


def in_a_process(function: str, *arguments: str) -> dict[str, float]:
    """The figures that a function of this module returns, worked out in a process of its own, with its peak memory."""
    code = (
        "import sys, json; sys.path.insert(0, sys.argv[1])\n"
        "import benchmark, benchmark_maps\n"
        "benchmark.cv2.setNumThreads(1)\n"
        "found = getattr(benchmark_maps, sys.argv[2])(*sys.argv[3:])\n"
        "print(json.dumps({**found, 'peak_mb': benchmark.peak_memory_mb()}))\n"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), function, *arguments]
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return dict(json.loads(out.splitlines()[-1]))


def building(dataset: Dataset, repeats: int) -> None:
    """Print time, memory and size of a map, and the time as a ratio to plain NumPy."""
    references = read_references(dataset.references)
    numpy_build = plain_numpy(references)
    calibrated = settings().observation.votes
    # The peer calibrates nothing.
    votes = calibrated.model_copy(update={"calibration_references": 0})
    # Kernels are compiled before anything is timed.
    VotesModel.build(
        replace(references, pixels=references.pixels[:2], positions=references.positions[:2], names=references.names[:2]),
        settings(2, spacing_m=0.5).observation.votes,
    )
    builds = {
        "package": lambda: VotesModel.build(references, votes),
        "NumPy": numpy_build,
        "calibrated": lambda: VotesModel.build(references, calibrated),
    }
    times: dict[str, list[float]] = {name: [] for name in builds}
    for _ in range(repeats):
        for name, build in builds.items():
            begin = time.process_time()
            build()
            times[name].append(time.process_time() - begin)
    package, peer, whole = (float(np.median(times[name])) for name in builds)
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "map")
        built = in_a_process("build_and_save", str(dataset.path), path)
        loaded = in_a_process("load", path)
    print(
        f"\n## Building the map of `{dataset.name}`: {len(references)} references, {int(built['places'])} places, p = {COMPONENTS}\n"
    )
    print("Depths, views and eigenspace, one thread; processor time, median of", f"{repeats}, both in turn.\n")
    print("| what | figure |\n|---|---|")
    print(f"| plain NumPy and OpenCV (tests/oracles/building.py) / panoloc_mcl | {peer / package:.2f} |")
    print(f"| the same with the calibration on held-out references / without | {whole / package:.2f} |")
    print(f"| panoloc_mcl without it | {package:.1f} s |")
    print(f"| peak memory of a process that reads the data set, builds and saves | {built['peak_mb']:.0f} MB |")
    print(f"| map file | {built['file_mb']:.1f} MB |")
    print(f"| load the map and make its observation model | {loaded['seconds']:.3f} s |")


def plain_numpy(references: ReferencePanoramas) -> Callable[[], object]:
    """The same map by the oracle of the tests."""
    sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
    from oracles import building as oracle

    from panoloc_mcl.robot.observation import Places
    from panoloc_mcl.robot.synthesis import virtual_positions
    from panoloc_mcl.robot.synthesis.views import FloorRays

    votes = settings().observation.votes
    assert references.camera_height_m is not None
    rays = FloorRays.of(references.geometry, references.camera_height_m)
    spacing = Places(references.positions).spacing
    positions = virtual_positions(references.positions, spacing, votes.virtual_places)
    return lambda: oracle.build(references, rays, positions, votes, COMPONENTS)


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
    many = replace(
        references,
        pixels=np.concatenate([references.pixels] * tiles),
        positions=positions,
        names=tuple(f"{tile}_{name}" for tile in range(tiles) for name in references.names),
    )
    arrays = dict(small.arrays)
    of_references = {"profiles", "alone"} & set(arrays)
    arrays.update({name: np.concatenate([arrays[name]] * tiles) for name in of_references})
    # In the order in which the map lays out its places.
    probe = VotesModel.restore(many, small.observation.votes, arrays).places.positions
    tile = np.argmin([np.abs(probe - offset - model.places.positions.mean(axis=0)).max(axis=1) for offset in offsets], axis=0)
    source = model.places.nearest(probe - offsets[tile])
    for name, array in small.arrays.items():
        if name not in of_references and name != "spectra" and len(array) == len(model.places):
            arrays[name] = array[source]
    return replace(small, references=many, arrays=arrays)


def images_of(panorama_map: PanoramaMap, path: str) -> dict[str, float]:
    """Median seconds of an image: vote field only, and from pixels to pose, particle filter included."""
    from benchmark import localizer_step

    dataset = read_dataset(path)
    drive = next(iter(dataset.sequences.values()))
    images = [read_image(file) for file in drive.files[:6]]
    observation = panorama_map.observation
    unrefined = observation.votes.model_copy(
        update={"refinement": observation.votes.refinement.model_copy(update={"enabled": False})}
    )
    field = panorama_map.observation_model(observation.model_copy(update={"votes": unrefined}))
    panoramas = [panorama_map.unwrapper(drive.camera, drive.image_size)(image) for image in images]
    config = RunConfig(observation=observation)
    state = {"count": 0}

    def vote_field() -> object:
        state["count"] += 1
        return field.observe(panoramas[state["count"] % len(panoramas)])

    medians = processor_time({"field": vote_field, "pose": localizer_step(panorama_map, config, images)}, 9)
    return {"places": len(field.places), "references": len(panorama_map.references), **medians}


def processor_time(tasks: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median seconds of the processor for each task, in turn: these are compared over processes, on a machine that may be busy."""
    spent: dict[str, list[float]] = {name: [] for name in tasks}
    for repeat in range(repeats + 1):
        for name, task in tasks.items():
            begin = time.process_time()
            task()
            # The first one compiles kernels and fills caches.
            spent[name] += [time.process_time() - begin] if repeat else []
    return {name: float(np.median(times)) for name, times in spent.items()}


def image_of_many(path: str, dataset: str) -> dict[str, float]:
    """One image against the map in a file."""
    return images_of(PanoramaMap.load(path), dataset)


def costs(dataset: Dataset, out: Path) -> None:
    """Print and plot the time of an image against the number of places, and of headings."""
    print(f"\n## Cost of one image of `{dataset.name}` against the number of places, one thread\n")
    print(
        "Processor time, medians. More places than the map has are the map several times side by side (tiles): as large as a real "
        "one, but alike. The vote field is without refinement; pixels to pose is all of it, particle filter included; memory is the "
        "peak of a process that loads the map and localizes.\n"
    )
    print(
        "| places | references | p | vote field, ms | pixels to pose, ms | images a second | peak memory, MB | map file, MB |"
    )
    print("|---|---|---|---|---|---|---|---|")
    by_places = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map"
        plain = settings(len(dataset.references), enabled=False).observation
        maps: list[tuple[int, Callable[[], PanoramaMap]]] = [
            (len(dataset.references), lambda: PanoramaMap.build(dataset, plain)),
            (COMPONENTS, lambda: PanoramaMap.build(dataset, settings().observation)),
        ]
        many = PanoramaMap.build(dataset, settings(COMPONENTS_OF_MANY).observation)
        maps += [(COMPONENTS_OF_MANY, lambda tiles=tiles: tiled(many, tiles)) for tiles in TILES]
        for components, make in maps:
            make().save(path)
            found = in_a_process("image_of_many", str(path), str(dataset.path))
            by_places.append((found["places"], found["field"], found["pose"]))
            print(
                f"| {found['places']:.0f} | {found['references']:.0f} | {components} | {1e3 * found['field']:.1f} "
                f"| {1e3 * found['pose']:.1f} | {1.0 / found['pose']:.1f} | {found['peak_mb']:.0f} "
                f"| {path.stat().st_size / 1e6:.0f} |",
                flush=True,
            )
    print(f"\n## Cost of one image of `{dataset.name}` against the number of headings, one thread\n")
    print(
        "Processor time, medians. Panoramas resized to other widths; virtual places by the map's rule, p =", f"{COMPONENTS}.\n"
    )
    print("| headings | vote field, ms | with refinement, ms |\n|---|---|---|")
    by_headings = []
    for columns in COLUMNS:
        field, refined = heading_cost(dataset, columns)
        by_headings.append((columns, field, refined))
        print(f"| {columns} | {1e3 * field:.1f} | {1e3 * refined:.1f} |", flush=True)
    plot(np.array(by_places), np.array(by_headings), out / "benchmark_costs.png")


def heading_cost(dataset: Dataset, columns: int) -> tuple[float, float]:
    """Median seconds of an image of another width: vote field, and with the refinement."""
    references = read_references(dataset.references)

    def resized(image: np.ndarray) -> np.ndarray:
        kind = cv2.INTER_AREA if columns < image.shape[1] else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (columns, image.shape[0]), interpolation=kind))

    geometry = references.geometry
    other = replace(
        references,
        pixels=np.stack([resized(image) for image in references.pixels]),
        valid=None if references.valid is None else resized(references.valid.astype(np.uint8)) > 0,
        geometry=PanoramaGeometry(columns, geometry.height, geometry.elevation_bottom_deg, geometry.elevation_top_deg),
    )
    votes = settings().observation.votes
    model = VotesModel.build(other, votes)
    unrefined = votes.model_copy(update={"refinement": votes.refinement.model_copy(update={"enabled": False})})
    field = VotesModel.restore(other, unrefined, model.arrays())
    drive = next(iter(dataset.sequences.values()))
    image = Panorama(resized(read_image(drive.files[0])).astype(np.float32), None)
    medians = processor_time({"field": lambda: field.observe(image), "refined": lambda: model.observe(image)}, 9)
    return medians["field"], medians["refined"]


def plot(by_places: np.ndarray, by_headings: np.ndarray, path: Path) -> None:
    """Both tables as one picture."""
    try:
        import matplotlib
    except ImportError:
        print("\nNo plot: matplotlib is missing; install the package with its extra `plot`.")
        return
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullLocator

    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.6), constrained_layout=True)
    for axis, table, label, second in (
        (axes[0], by_places, "places", "pixels to pose"),
        (axes[1], by_headings, "headings", "with refinement"),
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
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    plt.close(figure)
    print(f"\nPlot: {path}")

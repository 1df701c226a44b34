"""Speed and memory as ratios against named peers, measured interleaved in one run. Prints Markdown.

    python scripts/benchmark.py [--dataset PATH_OR_NAME] [--repeats N]
    python scripts/benchmark.py --build | --costs [--out FOLDER] [--dataset PATH_OR_NAME]

Everything runs on one thread. Medians over the repeats; the peers are OpenCV's template matching of all headings, and the machine's
own matrix product.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

# Before NumPy is loaded, which reads them once.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import benchmark_filter  # noqa: E402
import benchmark_report  # noqa: E402
import benchmark_voting  # noqa: E402
import cv2  # noqa: E402
import numpy as np  # noqa: E402

from panoloc_mcl import Localizer  # noqa: E402
from panoloc_mcl.robot.map.panorama_map import PanoramaMap  # noqa: E402
from panoloc_mcl.tools.config import RunConfig, config_from_mapping  # noqa: E402
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image, resolve_dataset  # noqa: E402
from panoloc_mcl.tools.runs.map_cache import cached_map  # noqa: E402

WITHOUT_VIRTUAL = {"observation": {"votes": {"virtual_places": {"enabled": False}}}}
WITHOUT_REFINEMENT = {"observation": {"votes": {"refinement": {"enabled": False}}}}


def interleaved(tasks: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median seconds of each task, all run in turn, so that a busy moment of the machine strikes all alike."""
    for task in tasks.values():
        task()
    spent: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, task in tasks.items():
            begin = time.perf_counter()
            task()
            spent[name].append(time.perf_counter() - begin)
    return {name: statistics.median(times) for name, times in spent.items()}


def localizer_step(panorama_map: PanoramaMap, config: RunConfig, images: list[np.ndarray]) -> Callable[[], object]:
    """One image from pixels to pose, image after image, with a running clock."""
    localizer = Localizer(panorama_map, config)
    state = {"count": 0}

    def step() -> object:
        state["count"] += 1
        return localizer.add_image(float(state["count"]), images[state["count"] % len(images)])

    return step


def template_matching(panorama_map: PanoramaMap, images: list[np.ndarray]) -> Callable[[], object]:
    """OpenCV's normalised cross-correlation of one image with every reference at every heading."""
    image = images[0] if images[0].ndim == 2 else cv2.cvtColor(images[0], cv2.COLOR_BGR2GRAY)
    wrapped = np.hstack([image, image[:, :-1]])
    references = list(panorama_map.references.pixels)
    return lambda: [cv2.matchTemplate(wrapped, reference, cv2.TM_CCOEFF_NORMED) for reference in references]


def speed(dataset: Dataset, repeats: int) -> None:
    """Print the time of one image as a ratio to template matching."""
    drive = next(iter(dataset.sequences.values()))
    images = [read_image(file) for file in drive.files[:8]]
    variants = {
        "pixels to pose, without virtual places": config_from_mapping(WITHOUT_VIRTUAL),
        "pixels to pose, virtual places, no refinement": config_from_mapping(WITHOUT_REFINEMENT),
        "pixels to pose, all of it": RunConfig(),
    }
    maps = {name: cached_map(dataset, config.observation, 0) for name, config in variants.items()}
    tasks: dict[str, Callable[[], object]] = {
        name: localizer_step(maps[name], config, images) for name, config in variants.items()
    }
    first = next(iter(maps.values()))
    for name, config in list(variants.items())[:2]:
        model, unwrap = maps[name].observation_model(config.observation), maps[name].unwrapper(drive.camera, drive.image_size)
        label = name.replace("pixels to pose", "pixels to vote field").replace(", no refinement", "")
        tasks[label] = lambda model=model, unwrap=unwrap: model.observe(unwrap(images[0]))
    tasks["cv2.matchTemplate"] = template_matching(first, images)
    square = np.random.default_rng(0).standard_normal((1024, 1024)).astype(np.float32)
    tasks["matrix product 1024 x 1024, float32"] = lambda: square @ square
    medians = interleaved(tasks, repeats)
    peer = medians["cv2.matchTemplate"]
    print(f"\n## One image of `{dataset.name}`: {len(first.references)} references, {first.geometry.width} headings\n")
    print("cv2.matchTemplate (TM_CCOEFF_NORMED, query wrapped, every reference), one thread = 1.\n")
    print("| what | time / template matching | times faster |")
    print("|---|---|---|")
    for name, median in medians.items():
        print(f"| {name} | {median / peer:.4f} | {peer / median:.1f} |")
    field, full = (medians[f"pixels to pose, {part}"] for part in ("virtual places, no refinement", "all of it"))
    vote_field = medians["pixels to vote field, virtual places"]
    print(f"\nRefinement takes {(full - field) / vote_field:.1f} times the vote field.")


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, megabytes."""
    status = Path("/proc/self/status")
    if status.exists():
        # getrusage would count the process that this one was forked from.
        return float(next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def startup(repeats: int) -> None:
    """Print start-up times as multiples of starting Python with NumPy."""
    panoloc = [sys.executable, "-m", "panoloc_mcl.tools.cli.main"]
    commands = {
        "python -c 'import numpy'": [sys.executable, "-c", "import numpy"],
        "python -c 'import panoloc_mcl'": [sys.executable, "-c", "import panoloc_mcl"],
        "panoloc --help": [*panoloc, "--help"],
    }
    medians = interleaved(
        {
            name: lambda command=command: subprocess.run(command, check=True, capture_output=True)
            for name, command in commands.items()
        },
        repeats,
    )
    base = medians["python -c 'import numpy'"]
    print("\n## Start\n\n| command | time / importing NumPy | seconds |\n|---|---|---|")
    for name, median in medians.items():
        print(f"| `{name}` | {median / base:.2f} | {median:.2f} |")


def whole_run(dataset: str) -> None:
    """Print peak memory and the time to the first pose of a run in a process of its own, map and kernels cached."""
    script = (
        "import sys, time; begin = time.perf_counter()\n"
        "from panoloc_mcl import pipeline, localizer\n"
        "from panoloc_mcl.tools.config import config_from_mapping\n"
        "first = []\n"
        "add = localizer.Localizer.add_image\n"
        "def timed(self, *a):\n"
        "    out = add(self, *a)\n"
        "    first.append(time.perf_counter() - begin)\n"
        "    return out\n"
        "localizer.Localizer.add_image = timed\n"
        "pipeline.run(config_from_mapping({'dataset': sys.argv[1], 'out': sys.argv[2]}))\n"
        "sys.path.insert(0, sys.argv[3])\n"
        "from benchmark import peak_memory_mb\n"
        "print(first[0], peak_memory_mb())\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", script, dataset, folder, str(Path(__file__).parent)]
        subprocess.run(command, check=True, capture_output=True)
        out = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    print("\n## A whole run, map and kernels cached\n\n| what | figure |\n|---|---|")
    print(f"| start of Python to the first pose | {float(out[0]):.2f} s |")
    print(f"| peak memory | {float(out[1]):.0f} MB |")


def main() -> None:
    """Run all benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--build", action="store_true", help="only: building a map against plain NumPy (a minute or two)")
    parser.add_argument(
        "--costs", action="store_true", help="only: cost against the number of places and headings, with a plot"
    )
    parser.add_argument("--voting", action="store_true", help="only: the paper's voting against plain NumPy")
    parser.add_argument("--filter", action="store_true", help="only: the particle filter against NumPy and two packages")
    parser.add_argument("--report", action="store_true", help="only: writing the report against its run, and its memory")
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder of the plot")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    path = Path(resolve_dataset(arguments.dataset))
    print(f"{os.cpu_count()} cores, {arguments.repeats} repeats, medians, one thread")
    if arguments.voting:
        benchmark_voting.voting(read_dataset(path), arguments.repeats, interleaved)
        return
    if arguments.filter:
        benchmark_filter.filter_speed(repeats=arguments.repeats)
        benchmark_filter.filter_memory()
        return
    if arguments.report:
        benchmark_report.report_share(str(path), min(arguments.repeats, 3))
        benchmark_report.long_run(str(path), 500)
        return
    if arguments.build or arguments.costs:
        # Only here, as these sections import this module.
        import benchmark_maps

        if arguments.build:
            benchmark_maps.building(read_dataset(path), repeats=min(arguments.repeats, 3))
        if arguments.costs:
            benchmark_maps.costs(read_dataset(path), arguments.out)
        return
    speed(read_dataset(path), arguments.repeats)
    benchmark_voting.voting(read_dataset(path), arguments.repeats, interleaved)
    benchmark_filter.filter_speed([10_000, 100_000], arguments.repeats)
    startup(arguments.repeats)
    whole_run(str(path))
    benchmark_report.report_share(str(path), min(arguments.repeats, 3))
    print(f"\nPeak memory of this benchmark: {peak_memory_mb():.0f} MB")


if __name__ == "__main__":
    main()

"""What it costs that a map mends itself, and to make one of drives: time and memory, each in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.laboratory.timing import in_a_process
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_drives import drives_of

# Errors of given poses that there is something to mend of, as of a survey by tape; drawn once.
_SD_M, _SD_DEG = 0.02, 1.0


def mapping(dataset: str, drives: Sequence[str], repeats: int) -> Report:
    """Time and memory of maps of references, mended or not, and of a map of drives.

    Parameters
    ----------
    dataset : str
    drives : sequence of str
        Names or globs of drives with odometry; none: only references.
    repeats : int
        Of each; the fastest counts.
    """
    path = str(read_dataset(resolve_dataset(dataset)).path)
    tasks: dict[str, tuple[str, ...]] = {
        "references, poses as given": ("build", path, "no", "0"),
        "the same, mended, poses exact": ("build", path, "yes", "0"),
        f"the same, mended, poses off by {100 * _SD_M:g} cm and {_SD_DEG:g} degree": ("build", path, "yes", "1"),
    }
    if drives:
        tasks = {f"drives {', '.join(drives)}": ("build_of_drives", path, *drives)}
    report = Report(f"Making maps of `{dataset}`: by the clock, with all cores, and of the processor; fastest of {repeats}.")
    heads = ("map", "keyframes", "seconds", "processor seconds", "seconds / the first", "seconds a keyframe", "peak memory, MB")
    table = report.table("", heads)
    first = 0.0
    for name, (function, *arguments) in tasks.items():
        found = min(
            (in_a_process(f"{__name__}:{function}", *arguments) for _ in range(repeats)), key=lambda one: float(one["seconds"])
        )
        first = first or found["seconds"]
        table.add(
            name,
            int(found["keyframes"]),
            Number(found["seconds"], 1),
            Number(found["processor"], 1),
            Number(found["seconds"] / first, 2),
            Number(found["seconds"] / found["keyframes"], 2),
            Number(found["peak_mb"]),
        )
    return report


def build(path: str, mend: str, disturbed: str) -> dict[str, float]:
    """Build a map of references, mended or not, with poses as given or off."""
    dataset = read_dataset(path)
    if disturbed == "1":
        references = dataset.references
        errors = np.random.default_rng(0).standard_normal(references.poses.shape) * (_SD_M, _SD_M, np.radians(_SD_DEG))
        dataset = replace(dataset, references=replace(references, poses=references.poses + errors))
    return _timed(lambda: PanoramaMap.build(dataset, settings=MapSettings(file=None, mend=mend == "yes")))


def build_of_drives(path: str, *names: str) -> dict[str, float]:
    """Build a map of drives."""
    dataset = read_dataset(path)
    return _timed(lambda: PanoramaMap.of_drives(dataset.name, drives_of(dataset, names)[0]))


def _timed(work: Callable[[], PanoramaMap]) -> dict[str, float]:
    clock, processor = time.perf_counter(), time.process_time()
    made = work()
    return {
        "seconds": time.perf_counter() - clock,
        "processor": time.process_time() - processor,
        "keyframes": len(made.keyframes),
    }

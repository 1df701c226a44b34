"""Where the time of an image goes, stage by stage, against what the machine's own matrix product reaches."""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from panoloc_mcl.laboratory.benchmarks.speed import ALONG, FIRST, along_a_drive
from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.laboratory.timing import matrix_product
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map


class Stage(NamedTuple):
    """Functions whose time belongs together: file, name, and, where only some calls count, the name of the caller."""

    name: str
    functions: tuple[tuple[str, str, str], ...]


# None of them calls another.
STAGES = (
    Stage("image to panorama", (("unwrap.py", "__call__", ""),)),
    Stage("features of the image", (("gradients.py", "orientations", "_observe"), ("gradients.py", "useless", ""))),
    Stage("votes of all places", (("correlator.py", "votes", ""),)),
    Stage("votes at a glance", (("correlator.py", "glance", ""),)),
    Stage("peaks of the field", (("field.py", "best_cells", ""), ("field.py", "weakened", ""), ("field.py", "peak", ""))),
    Stage("smoothed planes", (("planes.py", "planes_of", ""),)),
    Stage("image turned back", (("refinement.py", "_turned_back", ""),)),
    Stage("sources: which", (("refinement.py", "_weighted_sources", ""),)),
    Stage("views: where pixels come from", (("views.py", "profile_at", ""), ("views.py", "table", ""))),
    Stage("views: reading and features", (("planes.py", "read_planes", "_view"), ("gradients.py", "orientations", "_view"))),
    Stage("views: warping images", (("cv2", "remap", "view"),)),
    Stage("equations: sums over pixels", (("alignment.py", "column_products", ""),)),
    Stage(
        "equations: columns, sectors, solving",
        (
            ("agreeing_parts.py", "agreeing", ""),
            ("agreeing_parts.py", "contradiction", ""),
            ("alignment.py", "normal_equations", ""),
            ("alignment.py", "sector_pulls", ""),
            ("equations.py", "step", ""),
            ("refinement.py", "_is_still", ""),
            ("measurement.py", "of_columns", ""),
        ),
    ),
    Stage("covariance of the map", (("views.py", "errors_at", ""),)),
    Stage("confidence", (("calibration.py", "confidence", ""),)),
    Stage("filter: predict", (("monte_carlo.py", "propagate", ""),)),
    Stage("filter: update", (("monte_carlo.py", "update", ""),)),
)
# Additions and multiplications of a pixel in `column_products`, counted in its loops.
_SUMS_OF_A_PIXEL = 100


class Profile(NamedTuple):
    """Milliseconds and calls an image, by stage; the last stage is what is left. ``whole`` is their sum."""

    ms: dict[str, float]
    calls: dict[str, float]
    whole: float


def profile(dataset: str, out: Path | None) -> Report:
    """Profile a drive with tracking and without; with ``out`` also as a picture, profile.png.

    Parameters
    ----------
    dataset : str
    out : Path, optional
        Folder.
    """
    data = read_dataset(resolve_dataset(dataset))
    drive = next(iter(data.sequences.values()))
    config = config_from_mapping({})
    panorama_map = cached_map(data, config.observation, 0)
    images = min(ALONG, len(drive)) - FIRST
    profiles: dict[str, Profile] = {}
    for name, tracking in (("searching", False), ("tracking", True)):
        step = along_a_drive(panorama_map, config_from_mapping({"localizer": {"tracking": tracking}}), drive)
        profiles[name] = _profiled(step, images)
    peak = _best_rate(*matrix_product())
    report = Report(
        f"An image of `{data.name}`, stage by stage: {images} images of one drive, one thread, processor time under Python's "
        f"profiler, which makes small calls look dearer. A float32 matrix product runs at {peak:.0f} GFLOP/s.",
        facts={name: found._asdict() for name, found in profiles.items()},
    )
    for name, found in profiles.items():
        table = report.table(
            name.capitalize(), ("stage", "ms an image", "share, %", "calls an image", "of the product's speed, %")
        )
        work = _operations(panorama_map, found)
        for stage, ms in found.ms.items():
            speed = 100.0 * work[stage] / (1e6 * ms * peak) if stage in work and ms > 0.0 else np.nan
            share = 100.0 * ms / found.whole
            table.add(stage, Number(ms, 2), Number(share, 1), Number(found.calls[stage], 1), Number(speed, 0))
        table.add("all", Number(found.whole, 2), Number(100.0, 1), Number(1.0, 1), Number(np.nan, 0))
    if out is not None:
        draw(profiles, out / "profile.png")
    return report


def _profiled(step: Callable[[], object], images: int) -> Profile:
    watch = cProfile.Profile(time.thread_time)
    watch.enable()
    for _ in range(images):
        step()
    watch.disable()
    # By function: calls, primitive calls, own time, time with what it calls, and the same by caller.
    known: dict[tuple[str, int, str], Any] = pstats.Stats(watch).stats  # type: ignore[attr-defined]
    ms, calls = {}, {}
    for stage in STAGES:
        found = [_spent(known, *function) for function in stage.functions]
        ms[stage.name] = 1e3 * sum(seconds for seconds, _ in found) / images
        calls[stage.name] = max(count for _, count in found) / images
    whole = 1e3 * _spent(known, "localizer.py", "add_image", "")[0] / images
    ms["the rest"], calls["the rest"] = whole - sum(ms.values()), 1.0
    return Profile(ms, calls, whole)


def _spent(known: dict[tuple[str, int, str], Any], file: str, name: str, caller: str) -> tuple[float, int]:
    """Seconds and calls of a function, of all callers or of one."""
    seconds, count = 0.0, 0
    for (path, _, function), (_, calls, _, total, callers) in known.items():
        compiled = file == "cv2" and function.strip("{}<>").endswith(name)
        if not compiled and (Path(path).name != file or function != name):
            continue
        if not caller:
            seconds, count = seconds + total, count + calls
        for (_, _, by), (_, calls_by, _, total_by) in callers.items() if caller else ():
            if by == caller:
                seconds, count = seconds + total_by, count + calls_by
    return seconds, count


def _operations(panorama_map: PanoramaMap, found: Profile) -> dict[str, float]:
    """Additions and multiplications an image, of the stages where they can be counted."""
    arrays = panorama_map.observation_model(config_from_mapping({}).observation).arrays()
    (frequencies, rows, components), places = arrays["spectra_real"].shape, len(arrays["coefficients"])
    headings = panorama_map.geometry.width
    votes = 8.0 * frequencies * components * rows + 4.0 * headings * components * places
    # Every second row of views of full size, which are those whose images are warped.
    sums = found.calls["views: warping images"] * _SUMS_OF_A_PIXEL * 0.5 * rows * headings
    return {"votes of all places": votes * found.calls["votes of all places"], "equations: sums over pixels": sums}


def _best_rate(product: Callable[[], object], operations: float) -> float:
    """GFLOP/s of the best of some rounds."""
    spent = []
    for _ in range(6):
        begin = time.thread_time()
        product()
        spent.append(time.thread_time() - begin)
    return operations / min(spent) / 1e9


def draw(profiles: dict[str, Profile], path: Path) -> None:
    """Stages as bars, one under the other; needs the extra plot."""
    from matplotlib.figure import Figure

    from panoloc_mcl.laboratory.comparison.summaries.plots import save_png

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axis = figure.subplots()
    names = [*(stage.name for stage in STAGES), "the rest"]
    height = 0.8 / len(profiles)
    for number, (label, found) in enumerate(profiles.items()):
        where = np.arange(len(names)) + height * (number - 0.5 * (len(profiles) - 1))
        axis.barh(where, [found.ms[name] for name in names], height, label=f"{label}: {found.whole:.1f} ms")
    axis.set_yticks(np.arange(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlabel("ms an image, one thread, under the profiler")
    axis.grid(True, axis="x", alpha=0.3)
    axis.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    save_png(figure, path)

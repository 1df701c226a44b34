"""One image, from pixels to pose, against OpenCV's template matching of all headings; and start-up and a whole run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Number, Ratio, Report
from panoloc_mcl.laboratory.timing import in_a_process, interleaved, matrix_product, template_matching
from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.interface.messages import Image, Odometry
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.observation.scale import references_at
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import PoseRefiner, ViewSynthesizer
from panoloc_mcl.tools.config import RunConfig, config_from_mapping
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import recorded

VARIANTS: dict[str, dict[str, Any]] = {
    "without virtual places": {"virtual_places": {"enabled": False}},
    "virtual places, no refinement": {"refinement": {"enabled": False}},
    "all of it": {},
}
# Images of a drive: at most, and those that find the pose.
ALONG, FIRST = 60, 3
PEER, PRODUCT = "cv2.matchTemplate", "matrix product 1024 x 1024, float32"


def speed(dataset: str, repeats: int, variants: Sequence[str] = tuple(VARIANTS)) -> Report:
    """Time of one image as a ratio to template matching: of some `VARIANTS`, each with a map of its own, and along a drive."""
    data = read_dataset(resolve_dataset(dataset))
    drive = next(iter(data.sequences.values()))
    images = [read_image(file) for file in drive.files[:8]]
    tasks: dict[str, Callable[[], object]] = {}
    for name in variants:
        votes = VARIANTS[name]
        config = config_from_mapping({"observation": {"votes": votes}})
        panorama_map = cached_map(data, config.observation, 0)
        tasks[f"pixels to pose, {name}"] = localizer_step(panorama_map, config, images)
        if votes:
            model, unwrap = (
                panorama_map.observation_model(config.observation),
                panorama_map.unwrapper(drive.camera, drive.image_size),
            )
            label = f"pixels to vote field, {name.removesuffix(', no refinement')}"
            tasks[label] = partial(_vote_field, model, unwrap, images[0])
    panorama_map = cached_map(data, config_from_mapping({}).observation, 0)
    for tracking in (False, True):
        how = "tracking" if tracking else "searching all over the map"
        config = config_from_mapping({"localizer": {"tracking": tracking}})
        tasks[f"pixels to pose, along a drive, {how}"] = along_a_drive(panorama_map, config, drive)
    tasks |= at_the_least(panorama_map, drive, images[0])
    panorama = panorama_map.unwrapper(drive.camera, drive.image_size)(images[0])
    tasks[PEER] = template_matching(panorama.pixels, panorama_map.references.pixels)
    tasks[PRODUCT], _ = matrix_product()
    repeats = min(repeats, len(drive.files) - FIRST - 1, ALONG - FIRST - 1)
    spent = interleaved(tasks, repeats)
    references, geometry = len(panorama_map.references), panorama_map.geometry
    report = Report(
        f"One image of `{data.name}`: {references} references, {geometry.width} headings, one thread, {repeats} rounds in turns, "
        "processor time. "
        "cv2.matchTemplate (TM_CCOEFF_NORMED, query wrapped, every reference) = 1."
    )
    table = report.table("", ("what", "ms", "time / template matching (95 %)", "times faster (95 %)"))
    for name, times in spent.items():
        peer, own = spent[PEER].processor, times.processor
        table.add(name, Number(1e3 * float(np.median(own)), 2), Ratio.of(own, peer), Ratio.of(peer, own))
    return report


def _vote_field(model: ObservationModel, unwrap: Unwrapper, image: NDArray[Any]) -> object:
    return model.observe(unwrap(image))


def localizer_step(
    panorama_map: PanoramaMap, config: RunConfig, images: Sequence[NDArray[Any]]
) -> Callable[[], Estimate | None]:
    """One image from pixels to pose, image after image, with a running clock."""
    localizer, number = Localizer(panorama_map, config), count(1)

    def step() -> Estimate | None:
        index = next(number)
        return localizer.add_image(float(index), images[index % len(images)])

    return step


def along_a_drive(panorama_map: PanoramaMap, config: RunConfig, drive: Drive) -> Callable[[], Estimate | None]:
    """The next image of a drive from pixels to pose, with its odometry; the first ones, which find the pose, are taken at once."""
    localizer = Localizer(panorama_map, config, camera=drive.camera, image_size=drive.image_size)
    # In the order of time: a localizer keeps no more odometry than late images need. Images are read before the clock runs.
    messages = iter(
        [
            replace(message, source=read_image(drive.files[message.index])) if isinstance(message, Image) else message
            for message in recorded(drive)
            if isinstance(message, Odometry | Image) and message.timestamp <= drive.times[min(ALONG, len(drive)) - 1]
        ]
    )

    def step() -> Estimate | None:
        for message in messages:
            estimate = localizer.add(message)
            if isinstance(message, Image):
                return estimate
        return None

    for _ in range(FIRST):
        step()
    return step


def at_the_least(panorama_map: PanoramaMap, drive: Drive, image: NDArray[Any]) -> dict[str, Callable[[], object]]:
    """What cannot be left out where an image is compared with a view of its own size, by itself: its features; one view, one step."""
    config = config_from_mapping({})
    model, settings = panorama_map.observation_model(config.observation), config.observation.votes
    arrays, height = model.arrays(), panorama_map.references.camera_height_m
    if height is None or "profiles" not in arrays:
        return {}
    references = references_at(panorama_map.references.of(arrays["used"]), tuple(arrays["shape"]))
    synthesizer = ViewSynthesizer(references, arrays["profiles"].astype(np.float64), height)
    once = {"refinement": {**settings.refinement.model_dump(), "sources": 1, "iterations": 1}}
    refiner = PoseRefiner(synthesizer, VotesSettings.model_validate({**settings.model_dump(), **once}))
    unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)

    def features() -> tuple[NDArray[np.complex64], NDArray[np.bool_]]:
        return orientations(unwrap(image), settings)

    z, usable = features()
    guess = model.observe(unwrap(image)).guess
    assert guess is not None
    # From where it has come to rest: another step would be the last, too.
    at_rest = refiner.polish(z, usable, guess.pose).pose
    return {
        "pixels to features, nothing else": features,
        "one Gauss-Newton step against one view, nothing else": lambda: refiner.polish(z, usable, at_rest),
    }


def start(dataset: str, repeats: int) -> Report:
    """Start-up as multiples of starting Python with NumPy; a whole run's time to the first pose, and its peak memory."""
    report = Report(f"Start, {repeats} rounds in turns; a whole run over `{dataset}` with map and kernels cached.")
    panoloc = [sys.executable, "-m", "panoloc_mcl"]
    commands = {
        "python -c 'import numpy'": [sys.executable, "-c", "import numpy"],
        "python -c 'import panoloc_mcl'": [sys.executable, "-c", "import panoloc_mcl"],
        "panoloc --help": [*panoloc, "--help"],
    }
    quiet = {name: partial(subprocess.run, command, check=True, capture_output=True) for name, command in commands.items()}
    spent = interleaved(quiet, repeats)
    table = report.table("Start", ("command", "seconds", "time / importing NumPy (95 %)"))
    base = next(iter(spent.values())).clock
    for name, times in spent.items():
        table.add(f"`{name}`", Number(float(np.median(times.clock)), 2), Ratio.of(times.clock, base))
    # Once before, for the caches.
    found = [in_a_process(f"{__name__}:first_pose", dataset) for _ in range(2)][-1]
    table = report.table("A whole run", ("what", "figure"))
    table.add("begin of the run to the first pose, s", Number(found["seconds"], 2))
    table.add("peak memory, MB", Number(found["peak_mb"]))
    return report


def first_pose(dataset: str) -> dict[str, float]:
    """Run in this process, and say how long it took to the first pose."""
    from panoloc_mcl.tools.report.sinks import Frame, NullSink
    from panoloc_mcl.tools.runs.pipeline import run

    begin, first = time.perf_counter(), []

    class Watch(NullSink):
        def take(self, frame: Frame) -> None:
            first.append(time.perf_counter() - begin)

    with tempfile.TemporaryDirectory() as folder:
        run(config_from_mapping({"dataset": dataset, "out": folder}), sinks=[Watch()])
    return {"seconds": first[0]}

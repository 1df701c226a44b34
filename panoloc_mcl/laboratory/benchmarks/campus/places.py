"""What an image costs on maps of a thousand, ten thousand and a hundred thousand places, and whether it is found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.benchmarks.campus.building import COLUMNS, Float64, build, geometry, held_out
from panoloc_mcl.laboratory.benchmarks.campus.rooms import SIZE_M, rooms
from panoloc_mcl.laboratory.comparison.summaries.plots import save_png
from panoloc_mcl.laboratory.reports import Number, Rate, Ratio, Report
from panoloc_mcl.laboratory.timing import in_a_process, interleaved, memory_mb
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.observation.calibration import CONDITIONS, DIM, Disturb
from panoloc_mcl.tools.config import config_from_mapping

# Images of the drive, so far apart, and those before which time is not taken.
_DRIVE, _STEP_M, _BEFORE = 40, 0.05, 8
_GLOBAL = 15
_FOUND_M, _FOUND_DEG = 0.5, 10.0
_DISTURBED: dict[str, Disturb | None] = dict(
    zip(
        ("as it is", "bars over 60 %", "noise, darker", "uneven light", "blobs over 40 %", "uneven light, half as bright"),
        (*CONDITIONS, DIM),
        strict=True,
    )
)
_ERRORS = (("position_mm", 1), ("heading_deg", 2), ("away_mm", 1))


def places(counts: Sequence[int], images: int, out: Path | None = None, disturbed: int = 0) -> Report:
    """Cost, memory and recall against the number of places; with ``out`` also as a picture, ``places.png`` there.

    Parameters
    ----------
    counts : sequence of int
        Numbers of rooms, the smallest first.
    images : int
        By which recall is measured, on each map.
    out : Path, optional
    disturbed : int
        So many images are disturbed in each of several ways, and true places ranked by them, on maps that are retrieved from.
    """
    report = Report(
        f"Maps of a simulated building, panoramas of {COLUMNS} columns. Its rooms have one size, one floor, and doors, windows, "
        "shelves and pictures of one kind, which hang and stand elsewhere in each. A process a map, one thread, processor time. "
        "Global: the first image of a robot that knows nothing, from pixels to pose. Tracked: an image along a drive, with "
        "`localizer.tracking`; the mean has the searches of the whole map (every tenth image), too. Resident: the peak of the process "
        "after all this. Recall: images from anywhere whose nearest place is among those that are voted on. Found: pose of one image "
        "within 0.5 m and 10 degrees, and how far those that are found are off."
    )
    costs = report.table(
        "Cost",
        (
            *(
                "places",
                "references",
                "voted on",
                "global, ms",
                "global / the first (95 %)",
                "tracked, ms",
                "tracked / the first (95 %)",
            ),
            *("tracked, mean, ms", "resident, MB", "map file, MB"),
        ),
    )
    heads = ("places", "recall", "found", "position, median, mm", "heading, median, degrees", "end of the drive, mm")
    recall = report.table("Recall", heads)
    words = str(images), str(disturbed)
    every = [in_a_process(f"{__name__}:measured", str(build(count)), str(count), *words) for count in counts]
    for found in every:
        ratios = (Ratio.of(np.array(found[kind]), np.array(every[0][kind])) for kind in ("global", "tracked"))
        costs.add(
            *(int(found["places"]), int(found["references"]), int(found["voted_on"])),
            *(Number(1e3 * float(np.median(found["global"])), 1), next(ratios)),
            *(Number(1e3 * float(np.median(found["tracked"])), 1), next(ratios)),
            Number(1e3 * float(np.mean(found["tracked"])), 1),
            *(Number(found["peak_mb"]), Number(found["file_mb"], 1)),
        )
        rates = (Rate.over((str(index), bool(hit)) for index, hit in enumerate(found[kind])) for kind in ("recalled", "found"))
        recall.add(int(found["places"]), *rates, *(Number(found[name], decimals) for name, decimals in _ERRORS))
    if disturbed:
        ranked = report.table("Ranks of the true place", ("places", "image", "median", "99 %", "worst", "voted on"))
        for found in every:
            for name, ranks in found["ranks"].items():
                voted_on = Rate.over((str(index), rank < found["voted_on"]) for index, rank in enumerate(ranks))
                figures = (Number(float(np.quantile(ranks, share)), 1) for share in (0.5, 0.99, 1.0))
                ranked.add(int(found["places"]), name, *figures, voted_on)
    if out is not None:
        plot(every, out / "places.png")
    return report


def measured(path: str, count: str, images: str, disturbed: str) -> dict[str, object]:
    """Everything about one map."""
    panorama_map = PanoramaMap.load(path)
    model = panorama_map.observation_model()
    assert isinstance(model, VotesModel)
    tracked, away = along_a_drive(panorama_map, model)
    searched, every = searches(panorama_map, model, int(count)), held_out(int(count), int(images))
    answers = np.array([recalled(model, image, pose) for image, pose in every])
    errors = np.array([error_of(model, image, pose) for image, pose in every[: max(1, len(every) // 5)]])
    right = (errors[:, 0] <= _FOUND_M) & (errors[:, 1] <= _FOUND_DEG)
    return {
        "places": len(model.places),
        "references": len(panorama_map.references),
        "voted_on": len(model.places) if model.retrieval is None else model.retrieval.count,
        "global": searched,
        "tracked": tracked,
        "away_mm": 1e3 * away,
        "recalled": answers.tolist(),
        "found": right.tolist(),
        "position_mm": 1e3 * float(np.median(errors[right, 0])),
        "heading_deg": float(np.median(errors[right, 1])),
        "ranks": ranks(model, held_out(int(count), int(disturbed), seed=4)),
        "file_mb": Path(path).stat().st_size / 1e6,
        "resident_mb": memory_mb(peak=False),
    }


def searches(panorama_map: PanoramaMap, model: VotesModel, count: int) -> list[float]:
    """Processor seconds of images of a robot that knows nothing, from pixels to pose."""
    localizer = Localizer(panorama_map, config_from_mapping({}), model=model)
    images = iter([image for image, _ in held_out(count, _GLOBAL + 2, seed=2)] * 2)
    clock = iter(range(1, 10_000))

    def first() -> object:
        return localizer.add_image(float(next(clock)), next(images))

    def anew() -> None:
        localizer.relocalize()

    spent = interleaved({"anew": anew, "first": first}, _GLOBAL, warm_up=2)
    return [float(seconds) for seconds in spent["first"].processor]


def along_a_drive(panorama_map: PanoramaMap, model: VotesModel) -> tuple[list[float], float]:
    """Processor seconds of images along a drive in the first room, and how far its end was off, metres; infinite if not sure."""
    room, shape = rooms(1)[0], geometry()
    angle = np.linspace(0.0, _DRIVE * _STEP_M / 1.5, _DRIVE)
    middle = room.corner + 0.5 * np.array(SIZE_M)
    poses = np.column_stack([middle + 1.5 * np.column_stack([np.cos(angle), np.sin(angle)]), angle + 0.5 * np.pi])
    images = iter([(0.1 * index, pose, room.panorama(shape, pose)) for index, pose in enumerate(poses)])
    localizer = Localizer(panorama_map, config_from_mapping({"localizer": {"tracking": True}}), model=model)
    ends: list[float] = []

    def step() -> None:
        stamp, pose, image = next(images)
        localizer.add_odometry(stamp, pose)
        estimate = localizer.add_image(stamp, image)
        if estimate is not None:
            sure = estimate.status is Status.CONVERGED
            ends.append(float(np.hypot(*(estimate.pose - pose)[:2])) if sure else np.inf)

    spent = interleaved({"step": step}, _DRIVE - _BEFORE, warm_up=_BEFORE)["step"].processor
    return [float(seconds) for seconds in spent], ends[-1]


def recalled(model: VotesModel, image: np.ndarray, pose: Float64) -> bool:
    """Whether the place nearest to a pose is among those that its image is compared with."""
    if model.retrieval is None:
        return True
    z, _ = orientations(Panorama(image.astype(np.float32), None), model.settings)
    asked = model.retrieval.asked(model.retrieval.correlator.projections(z))
    return int(model.places.nearest(pose[None, :2])[0]) in asked.places[: asked.likely]


def ranks(model: VotesModel, every: Sequence[tuple[NDArray[np.uint8], Float64]]) -> dict[str, list[int]]:
    """How many places are ranked before the one nearest to where an image was taken, as it is and disturbed; none of a small map."""
    if model.retrieval is None:
        return {}
    correlator, found = model.retrieval.correlator, dict[str, list[int]]()
    for number, (name, condition) in enumerate(_DISTURBED.items()):
        for index, (image, pose) in enumerate(every):
            seen = image if condition is None else condition(image, np.random.default_rng([index, number]))
            z, _ = orientations(Panorama(seen.astype(np.float32), None), model.settings)
            likeness = correlator.likeness(correlator.projections(z))
            rank = np.count_nonzero(likeness > likeness[model.places.nearest(pose[None, :2])[0]])
            found.setdefault(name, []).append(int(rank))
    return found


def error_of(model: VotesModel, image: np.ndarray, pose: Float64) -> tuple[float, float]:
    """How far the pose of one image is off, metres and degrees."""
    guess = model.observe(Panorama(image.astype(np.float32), None)).guess
    if guess is None:
        return np.inf, np.inf
    turned = float(np.degrees(angle_difference(guess.pose[2], pose[2])))
    return float(np.hypot(*(guess.pose - pose)[:2])), abs(turned)


def plot(every: Sequence[dict[str, object]], path: Path) -> None:
    """Milliseconds an image and resident memory against the places; needs the extra plot."""
    from matplotlib.figure import Figure

    count = [int(str(found["places"])) for found in every]
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for kind, label, style in (("global", "nothing known", "o-"), ("tracked", "tracked", "s--")):
        left.loglog(count, [1e3 * float(np.median(np.asarray(found[kind]))) for found in every], style, label=label)
    left.set_ylabel("ms an image, one thread")
    left.legend()
    right.loglog(count, [float(str(found["peak_mb"])) for found in every], "o-")
    right.axhline(1000.0, color="0.6", linewidth=0.8)
    right.set_ylabel("resident memory, MB")
    for axes in (left, right):
        axes.set_xlabel("places")
        axes.grid(True, which="both", alpha=0.3)
    save_png(figure, path)

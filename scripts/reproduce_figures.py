"""The figures of ``reproduce_paper.py``: images, votes against rotation, rates against severity, and the speed beside the paper's."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.comparison.plots import draw_rates as draw_curve
from panoloc_mcl.laboratory.comparison.plots import save_png
from panoloc_mcl.laboratory.comparison.pooling import Group
from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.peers.paper import PaperModel
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.robot.camera import OmniCamera, Panorama, geometry_of
from panoloc_mcl.robot.eigenspace.pca import principal_components
from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.geometry import FloatArray, wrap_angle
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.config import load_config
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets.splice import group_of
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M
from panoloc_mcl.tools.runs.map_cache import cached_map

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
# The paper's figure 4 is about its place 20.
_PLACE = 20
_TURNS_DEG = np.arange(-60.0, 60.5, 2.0)
_CLEAR_DEG = 10.0
_SHOWN_PLACES = 5
_STEERABLE_PX = 3.0


class Bench:
    """A data set with the maps of both models, and its images at known poses.

    Parameters
    ----------
    dataset : Dataset
    images : int
        How many images at most a curve over many of them is made of.
    """

    def __init__(self, dataset: Dataset, images: int) -> None:
        self.dataset, self.images = dataset, images

    @cached_property
    def maps(self) -> dict[str, PanoramaMap]:
        """Of the models `paper` and `votes`; a model that this data set is too small for is left out."""
        found = {}
        for name in ("paper", "votes"):
            try:
                found[name] = cached_map(self.dataset, ObservationSettings(model=name), 0)
            except PanolocError as error:
                print(f"note: {name}: {error}", file=sys.stderr)
        return found

    @cached_property
    def models(self) -> dict[str, ObservationModel]:
        """By name; the paper's also with the steerable filters that it recommends, which blur."""
        found = {name: panorama_map.observation_model() for name, panorama_map in self.maps.items()}
        if "paper" not in found:
            return found
        settings = PaperSettings(filters="steerable", filter_width_px=_STEERABLE_PX)
        blurred = PaperModel.build(self.maps["paper"].references, settings)
        return {"paper": found["paper"], f"paper, steerable filters, {_STEERABLE_PX:g} px": blurred, **found}

    @property
    def map(self) -> PanoramaMap:
        """Any of the maps: they have the same references."""
        return next(iter(self.maps.values()))

    def drives(self, light: str) -> list[Drive]:
        """Sequences of a light that have ground truth."""
        every = self.dataset.sequences.items()
        return [drive for name, drive in every if group_of(name) == light and drive.groundtruth is not None]

    def frames(self, light: str) -> list[tuple[Drive, int, FloatArray]]:
        """Drive, index and true pose of every image of a light."""
        found = []
        for drive in self.drives(light):
            assert drive.groundtruth is not None
            found += [(drive, index, pose) for index, pose in enumerate(drive.groundtruth.at(drive.times))]
        return found

    def nearest(self, light: str, position: FloatArray) -> tuple[Drive, int, FloatArray]:
        """The image of a light that was taken nearest to a position."""
        return min(self.frames(light), key=lambda frame: float(np.hypot(*(frame[2][:2] - position))))

    def panorama(self, drive: Drive, index: int) -> Panorama:
        """An image as the map compares it."""
        return self.map.unwrapper(drive.camera, drive.image_size)(read_image(drive.files[index]))

    def upright(self, drive: Drive, index: int, pose: FloatArray) -> FloatArray:
        """An image turned to heading 0, by whole columns; float (rows, columns)."""
        return turned(self.panorama(drive, index).pixels, float(pose[2]))


def turned(pixels: Any, heading: float) -> Any:
    """A panorama that was taken at a heading, as one at heading 0 would have been, to whole columns."""
    # Columns run clockwise, headings counter-clockwise.
    return np.roll(pixels, -round(heading * pixels.shape[1] / (2.0 * np.pi)), axis=1)


def figure_1(bench: Bench, out: Path) -> list[str]:
    """Mean and eigenimages of the references."""
    references = bench.map.references.pixels
    images = references.reshape(len(references), -1).astype(np.float32)
    mean = images.mean(axis=0)
    count = min(4, len(images) - 1)
    space = principal_components(images - mean, count, "components")
    shape = references.shape[1:]
    pictures = [("mean", mean.reshape(shape))]
    pictures += [(f"eigenimage {index + 1}", image.reshape(shape)) for index, image in enumerate(space.eigenimages)]
    show(pictures, out / "figure_1.png")
    kept = {p: principal_components(images - mean, p, "components").kept for p in (count, 15) if p < len(images)}
    held = ", ".join(f"{100 * share:.0f} % with p = {p}" for p, share in kept.items())
    return [
        "## Figure 1: mean and eigenimages",
        "",
        "![Figure 1](figure_1.png)",
        "",
        f"Of the {len(images)} references; share of their variance that is kept: {held}.",
        "",
    ]


def figure_2(dataset: Dataset, omni: str | None, out: Path) -> list[str]:
    """A raw omnidirectional image and its cylinder."""
    lines = ["## Figure 2: omnidirectional image and cylinder", ""]
    beside = dataset.path.with_name(f"{dataset.path.name}_omni")
    source = read_dataset(Path(omni)) if omni else read_dataset(beside) if (beside / "dataset.yaml").is_file() else dataset
    for drive in source.sequences.values():
        if isinstance(drive.camera, OmniCamera):
            from panoloc_mcl.robot.camera import Unwrapper

            raw = read_image(drive.files[0])
            cylinder = Unwrapper(drive.camera, drive.image_size, geometry_of(drive.camera, drive.image_size))(raw)
            grey = raw if raw.ndim == 2 else raw.mean(axis=2)
            show([("omnidirectional image", grey), ("its cylinder", cylinder.pixels)], out / "figure_2.png", columns=2)
            return [*lines, f"`{source.name}`, {drive.name}.", "", "![Figure 2](figure_2.png)", ""]
    return [*lines, f"`{dataset.name}` has no raw omnidirectional images; name a data set that has some with `--omni`.", ""]


def figure_3(bench: Bench, lights: Sequence[str], out: Path) -> list[str]:
    """The place that was passed most closely in every light."""
    positions = bench.dataset.references.poses[:, :2]
    found = {light: np.array([pose[:2] for _, _, pose in bench.frames(light)]) for light in lights}
    apart = np.array([[np.hypot(*(frames - place).T).min() for frames in found.values()] for place in positions])
    place = int(np.argmin(apart.max(axis=1)))
    pictures = [(f"reference {place}", bench.map.references.pixels[place])]
    levels = []
    for light in lights:
        drive, index, pose = bench.nearest(light, positions[place])
        image = bench.upright(drive, index, pose)
        pictures.append((light, image))
        levels.append(f"{light} {image.mean():.0f}")
    show(pictures, out / "figure_3.png", same_scale=True)
    return [
        "## Figure 3: one place in different light",
        "",
        "![Figure 3](figure_3.png)",
        "",
        f"Place {place}, images at most {100 * apart[place].max():.0f} cm from it, turned to heading 0, one grey scale. "
        f"Mean grey levels: {', '.join(levels)}; reference {bench.map.references.pixels[place].mean():.0f}.",
        "",
    ]


def figure_4(bench: Bench, light: str, out: Path) -> list[str]:
    """Votes against rotation near place 20, and how often the right place leads."""
    from matplotlib.figure import Figure

    positions = bench.dataset.references.poses[:, :2]
    place = _PLACE if len(positions) > _PLACE else len(positions) // 2
    drive, index, pose = bench.nearest(light, positions[place])
    distance = float(np.hypot(*(pose[:2] - positions[place])))
    columns = len(bench.models)
    figure = Figure(figsize=(3.4 * columns + 0.4, 6.0), layout="constrained")
    panels = figure.subplots(2, columns, squeeze=False, sharex=True)
    lines = ["## Figure 4: votes against rotation", "", "![Figure 4](figure_4.png)", ""]
    lines += [
        f"Top: votes for an image {100 * distance:.0f} cm from place {place} (`{drive.name}`, image {index}), turned.",
        "",
    ]
    rows = []
    for column, name in enumerate(bench.models):
        votes = reference_votes(bench, name, bench.panorama(drive, index), float(pose[2]))
        _draw_votes(panels[0][column], votes, place, name)
        rows += [[name, f"{turn:g}", *(repr(float(v)) for v in row)] for turn, row in zip(_TURNS_DEG, votes, strict=True)]
        lines.append(f"* `{name}`: {shape_of(votes, place)}")
    header = ["model", "turn_deg", *(f"place_{k}" for k in range(len(positions)))]
    write_atomically(out / "figure_4.csv", "\n".join(",".join(row) for row in [header, *rows]) + "\n")
    near = [frame for frame in bench.frames(light) if np.hypot(*(positions - frame[2][:2]).T).min() <= PASS_RADIUS_M]
    chosen = near[:: max(1, len(near) // bench.images)][: bench.images]
    for column, name in enumerate(bench.models):
        if not chosen:
            break
        leads, shares = leading(bench, name, chosen)
        axes = panels[1][column]
        axes.plot(_TURNS_DEG, leads, color=_COLOURS[0], label="below: share of images in which the right place leads")
        axes.plot(_TURNS_DEG, shares, color=_COLOURS[1], label="below: its votes / those unturned, median")
        axes.set_ylim(-0.03, 1.1)
        lines.append(
            f"* `{name}`, {len(chosen)} images within {PASS_RADIUS_M:g} m of a place: the right place leads in "
            f"{100 * leads[len(leads) // 2]:.0f} % of them unturned, in at least 90 % {up_to(leads, 0.9)}, in at least half "
            f"{up_to(leads, 0.5)}; half of the votes at {half_width(shares):.1f}° (median)."
        )
    widths = {name: half_width(leading(bench, name, chosen)[1]) for name in list(bench.models)[:2]} if chosen else {}
    if len(widths) == 2 and "paper" in widths:
        (_, sharp), (name, blurred) = widths.items()
        lines.append(
            f"* The paper has a clear vote below about {_CLEAR_DEG:g}°. How wide the curve is here follows the filters: 3x3 gradients "
            f"lose half of their votes at {sharp:.1f}°, {name.partition(', ')[2]} at {blurred:.1f}°."
        )
    for axes in panels.flat:
        axes.axvspan(-_CLEAR_DEG, _CLEAR_DEG, color="#000000", alpha=0.06, linewidth=0)
        axes.tick_params(labelsize=8)
        axes.grid(True, alpha=0.25, linewidth=0.5)
    for axes in panels[0]:
        axes.legend(fontsize=7, frameon=False, loc="upper right")
    figure.legend(*panels[1][0].get_legend_handles_labels(), loc="outside upper center", ncols=2, fontsize=8, frameon=False)
    figure.supxlabel("turn from the reference heading [°]; shaded: where the paper has a clear vote", fontsize=9)
    save_png(figure, out / "figure_4.png")
    return [*lines, ""]


def reference_votes(bench: Bench, name: str, panorama: Panorama, heading: float) -> FloatArray:
    """Votes of all references for an image as if it were turned: float64 (turns, references).

    Of a model with places between the references, each reference has the most votes of the places that are nearest to it.
    """
    model = bench.models[name]
    asked = wrap_angle(heading + np.radians(_TURNS_DEG))
    field = model.observe(panorama, asked)
    if len(field.votes) == 1:
        field = model.observe(panorama)
    references = bench.map.references.positions
    owner = np.argmin(np.hypot(*(field.places.positions[:, None] - references[None]).transpose(2, 0, 1)), axis=1)
    votes = np.zeros((len(field.votes), len(references)))
    np.maximum.at(votes, (slice(None), owner), field.votes)
    return votes


def half_width(votes: FloatArray) -> float:
    """Turn at which votes (turns,) have fallen to half of those without a turn, the mean of both sides, degrees."""
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    widths = []
    for side, turns in ((votes[centre:], _TURNS_DEG[centre:]), (votes[centre::-1], -_TURNS_DEG[centre::-1])):
        below = np.flatnonzero(side <= 0.5 * votes[centre])
        if not len(below):
            return float("nan")
        end = below[0]
        widths.append(np.interp(0.5 * votes[centre], side[[end, end - 1]], turns[[end, end - 1]]))
    return float(np.mean(widths))


def up_to(leads: FloatArray, share: float) -> str:
    """Up to which turn, either way, at least such a share of images has the right place in the lead."""
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    both = np.minimum(leads[centre:], leads[centre::-1])
    if both[0] < share:
        return "nowhere"
    low = np.flatnonzero(both < share)
    return f"up to {_TURNS_DEG[centre + (low[0] - 1 if len(low) else len(both) - 1)]:g}°"


def shape_of(votes: FloatArray, place: int) -> str:
    """In words: where the right place leads, and how its votes fall."""
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    leads = np.argmax(votes, axis=1) == place
    if not leads[centre]:
        best = int(np.argmax(votes[centre]))
        return f"the right place does not lead at 0° (place {best} has {votes[centre, best]:.3f}, it has {votes[centre, place]:.3f})."
    left, right = centre, centre
    while left > 0 and leads[left - 1]:
        left -= 1
    while right < len(leads) - 1 and leads[right + 1]:
        right += 1
    own = votes[:, place]
    span = np.abs(_TURNS_DEG) <= 20.0
    rises = np.diff(own[span]) * np.sign(_TURNS_DEG[span][:-1] + 1.0) > 0.02 * own.max()
    return (
        f"the right place leads from {_TURNS_DEG[left]:g}° to {_TURNS_DEG[right]:g}°; its votes are half of those unturned at "
        f"{half_width(own):.1f}° and rise again by more than 2 % of it at {int(rises.sum())} of {int(span.sum()) - 1} steps within 20°."
    )


def leading(bench: Bench, name: str, frames: Sequence[tuple[Drive, int, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Over many images: how often the right place leads at each turn, and its votes relative to those without a turn."""
    positions = bench.map.references.positions
    leads, shares = [], []
    centre = int(np.argmin(np.abs(_TURNS_DEG)))
    for drive, index, pose in frames:
        votes = reference_votes(bench, name, bench.panorama(drive, index), float(pose[2]))
        right = int(np.argmin(np.hypot(*(positions - pose[:2]).T)))
        leads.append(np.argmax(votes, axis=1) == right)
        shares.append(votes[:, right] / max(votes[centre, right], 1e-9))
    return np.mean(leads, axis=0), np.median(shares, axis=0)


def _draw_votes(axes: Any, votes: FloatArray, place: int, title: str) -> None:
    others = [k for k in np.argsort(-votes.max(axis=0)) if k != place][:_SHOWN_PLACES]
    rest = [k for k in range(votes.shape[1]) if k != place and k not in others]
    if rest:
        axes.plot(_TURNS_DEG, votes[:, rest], color="#bbbbbb", linewidth=0.5)
    for k in others:
        axes.plot(_TURNS_DEG, votes[:, k], linewidth=0.9, alpha=0.9, linestyle="--", label=f"place {k}")
    axes.plot(_TURNS_DEG, votes[:, place], color=_COLOURS[1], linewidth=2.0, label=f"place {place}")
    axes.set_title(title, fontsize=9)
    axes.set_ylabel("votes", fontsize=8)


def pictured(bench: Bench, light: str, corruption: str, title: str, what: str, out: Path) -> list[str]:
    """An image before and after a corruption."""
    recipe = parse_recipe(corruption)
    drive, index, _ = bench.frames(light)[0]
    before = np.clip(np.rint(bench.panorama(drive, index).pixels), 0, 255).astype(np.uint8)
    geometry = bench.map.geometry
    after = recipe.image(before, np.random.default_rng(0), geometry.elevation_deg)
    file = f"{title.lower().replace(' ', '_')}.png"
    show([("original", before), (what, after)], out / file, same_scale=True)
    return [f"## {title}: {what}", "", f"![{title}]({file})", ""]


def draw_rates(
    of: Mapping[tuple[str, float], Group], methods: Sequence[str], severities: Sequence[float], kind: str, path: Path
) -> None:
    """Recognition against severity, one curve a method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for number, method in enumerate(methods):
        mine = {severity: [of[method, severity]] for severity in severities if (method, severity) in of}
        style = {"color": _COLOURS[number % len(_COLOURS)], "linestyle": ("-", "--", "-.", ":")[number % 4]}
        draw_curve(axes, mine, "recognition", method, style, 0.004 * (number - 1))
    axes.axvline(
        0.25 if kind == "random_pixels" else 0.7,
        color="#666666",
        linewidth=0.9,
        linestyle=(0, (1, 2)),
        label="up to here, says the paper",
    )
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel({"random_pixels": "share of random pixels", "bars": "share of columns occluded"}[kind])
    axes.set_ylabel("places recognised")
    axes.grid(True, alpha=0.25, linewidth=0.5)
    axes.legend(fontsize=8, frameon=False, loc="lower left")
    save_png(figure, path)


def speed(bench: Bench, methods: Mapping[str, str], configs: Path, paper_hz: float, rounds: int, light: str) -> list[str]:
    """One image from pixels to pose, with each method and in plain NumPy, in turns in one run."""
    drive = (bench.drives(light) or list(bench.dataset.sequences.values()))[0]
    images = [read_image(file) for file in drive.files[: rounds + 1]]
    tasks: dict[str, Callable[[int], object]] = {}
    for method, config in methods.items():
        settings = load_config(configs / f"{config}.yaml")
        if settings.observation.model not in bench.maps:
            continue
        panorama_map = bench.maps[settings.observation.model]
        start = None if drive.groundtruth is None else tuple(float(value) for value in drive.groundtruth.at(drive.times[0]))
        localizer = Localizer(panorama_map, settings, camera=drive.camera, image_size=drive.image_size, start_pose=start)
        tasks[method] = _cycle(localizer, drive, images)
    reference = _numpy_votes(bench, drive, images[0])
    if reference is not None:
        tasks["the paper's voting in plain NumPy: from filter responses to votes for 5 headings"] = reference
    spent: dict[str, list[float]] = {name: [] for name in tasks}
    for index in range(len(images)):
        for name, task in tasks.items():
            begin = time.perf_counter()
            task(index)
            if index:  # the first call pays for what is made once
                spent[name].append(time.perf_counter() - begin)
    lines = [
        "## Speed",
        "",
        f"One image from pixels to pose, in turns, one thread of BLAS each; the paper had {paper_hz} Hz.",
        "",
    ]
    lines += [
        "| | median ms | Hz | times the paper's |",
        "|---|---|---|---|",
        f"| paper | {1000 / paper_hz:.0f} | {paper_hz} | 1 |",
    ]
    for name, seconds in spent.items():
        if seconds:
            median = float(np.median(seconds))
            lines.append(f"| {name} | {1000 * median:.1f} | {1 / median:.1f} | {1 / median / paper_hz:.0f} |")
    return [*lines, ""]


def _cycle(localizer: Localizer, drive: Drive, images: Sequence[Any]) -> Callable[[int], object]:
    def step(index: int) -> object:
        if drive.odometry is not None and index == 0:
            for when, pose in zip(drive.odometry.times, drive.odometry.poses, strict=True):
                if when <= drive.times[len(images) - 1]:
                    localizer.add_odometry(float(when), pose)
        return localizer.add_image(float(drive.times[index]), images[index])

    return step


def _numpy_votes(bench: Bench, drive: Drive, image: Any) -> Callable[[int], object] | None:
    """The paper's voting for five headings by batched NumPy, as the tests hold it; None where the tests are not at hand."""
    if "paper" not in bench.models or not (Path(__file__).parents[1] / "tests" / "oracles").is_dir():
        return None
    from benchmark_voting import _tasks
    from threadpoolctl import threadpool_limits

    model = bench.models["paper"]
    panorama = bench.map.unwrapper(drive.camera, drive.image_size)(image)
    task = _tasks(model, bench.map.references.pixels, panorama, model.settings)["NumPy, three filters, float64"]

    def votes(index: int) -> object:
        with threadpool_limits(1, user_api="blas"):
            return task()

    return votes


def show(pictures: Sequence[tuple[str, Any]], path: Path, columns: int = 1, same_scale: bool = False) -> None:
    """Grey images with titles, as one PNG."""
    from matplotlib.figure import Figure

    rows = -(-len(pictures) // columns)
    heights = [
        max(image.shape[0] / image.shape[1] for _, image in pictures[row * columns : (row + 1) * columns])
        for row in range(rows)
    ]
    width = 6.0 / columns
    figure = Figure(figsize=(6.2, sum(width * h for h in heights) + 0.3 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    limits = {"vmin": 0, "vmax": 255} if same_scale else {}
    for axes, (title, image) in zip(panels.flat, pictures, strict=False):
        axes.imshow(image, cmap="gray", interpolation="nearest", **limits)
        axes.set_title(title, fontsize=8)
    for axes in panels.flat:
        axes.axis("off")
    save_png(figure, path)

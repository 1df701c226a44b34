"""Figures 1, 2, 3, 5 and 7: eigenimages, cylinders, one place in different light, corrupted images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.comparison.summaries.plots import save_png
from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.reproduction.bench import Bench
from panoloc_mcl.robot.camera import OmniCamera, Unwrapper, geometry_of
from panoloc_mcl.robot.eigenspace.pca import principal_components
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image


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
            raw = read_image(drive.files[0])
            cylinder = Unwrapper(drive.camera, drive.image_size, geometry_of(drive.camera, drive.image_size))(raw)
            grey = raw if raw.ndim == 2 else raw.mean(axis=2)
            show([("omnidirectional image", grey), ("its cylinder", cylinder.pixels)], out / "figure_2.png", columns=2)
            return [*lines, f"`{source.name}`, {drive.name}.", "", "![Figure 2](figure_2.png)", ""]
    return [*lines, f"`{dataset.name}` has no raw omnidirectional images; name a data set that has some with `--omni`.", ""]


def figure_3(bench: Bench, lights: Sequence[str], out: Path) -> list[str]:
    """The place that was passed most closely in every light."""
    positions = bench.dataset.references.poses[:, :2]
    found = {light: np.array([frame.truth[:2] for frame in bench.frames[light]]) for light in lights}
    apart = np.array([[np.hypot(*(frames - place).T).min() for frames in found.values()] for place in positions])
    place = int(np.argmin(apart.max(axis=1)))
    pictures = [(f"reference {place}", bench.map.references.pixels[place])]
    levels = []
    for light in lights:
        image = bench.upright(bench.nearest(light, positions[place]))
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


def pictured(bench: Bench, light: str, corruption: str, title: str, what: str, out: Path) -> list[str]:
    """An image before and after a corruption."""
    recipe = parse_recipe(corruption)
    before = np.clip(np.rint(bench.panorama(bench.frames[light][0]).pixels), 0, 255).astype(np.uint8)
    after = recipe.image(before, np.random.default_rng(0), bench.map.geometry.elevation_deg)
    file = f"{title.lower().replace(' ', '_')}.png"
    show([("original", before), (what, after)], out / file, same_scale=True)
    return [f"## {title}: {what}", "", f"![{title}]({file})", ""]


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

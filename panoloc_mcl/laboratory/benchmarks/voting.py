"""The paper's voting: against plain NumPy, and as a share of what the machine can multiply."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.benchmarks.plain_voting import vote_batched
from panoloc_mcl.laboratory.peers.linear_filters import basis_responses, filter_bank
from panoloc_mcl.laboratory.peers.paper import PaperModel
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.laboratory.reports import Number, Ratio, Report
from panoloc_mcl.laboratory.timing import interleaved, matrix_product
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.pca import principal_components
from panoloc_mcl.robot.kernels.voting import vote
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.datasets import read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map

Array = NDArray[Any]
Filters = Callable[[Array], Array]

# The paper's tests, 1000 pixels trimmed to 800 at once, and to 300 step by step.
TRIM_TO = (800, 300)
# Headings around the true one, degrees, as a Kalman filter draws them: M = 5.
HEADINGS_DEG = np.array([-6.3, -2.2, 0.4, 2.9, 7.7])
KERNEL, PEAK = "kernel (two basis filters, float32)", "peak"


def voting(dataset: str, repeats: int) -> Report:
    """Time of the votes for five headings as ratios to NumPy, and the share of the peak of matrix products."""
    data = read_dataset(resolve_dataset(dataset))
    drive = next(iter(data.sequences.values()))
    panorama_map = cached_map(data, ObservationSettings(model="paper"), 0)
    panorama = panorama_map.unwrapper(drive.camera, drive.image_size)(read_image(drive.files[0]))
    report = Report(
        f"The paper's voting on `{data.name}`, one thread: from filter responses to votes, {repeats} rounds in turns."
    )
    for trim_to in TRIM_TO:
        settings = PaperSettings(trim_to=trim_to)
        tasks = tasks_of(panorama_map, panorama, settings)
        votes = {name: task() for name, task in tasks.items()}
        for name, found in votes.items():
            # The same computation: single precision may trim another pixel here and there.
            assert np.abs(found - votes[KERNEL]).max() < 0.01, name
        product, operations = matrix_product()
        spent = interleaved({**tasks, PEAK: product}, repeats)
        places, kernel = len(panorama_map.references), spent[KERNEL].clock
        work = needed_operations(settings, len(HEADINGS_DEG), places)
        share = 100.0 * (work / np.median(kernel)) / (operations / np.median(spent[PEAK].clock))
        table = report.table(
            f"{len(HEADINGS_DEG)} headings x {settings.hypotheses} hypotheses x {settings.pixels} pixels trimmed to {trim_to}, "
            f"p = {settings.components}, {places} places",
            ("what", "ms", "times as long as the kernel (95 %)"),
            f"{1e-6 * work:.0f} million operations are needed (`needed_operations`); the kernel does them at {share:.0f} % of the "
            "rate of float32 matrix products in this run.",
        )
        for name in votes:
            table.add(name, Number(1e3 * float(np.median(spent[name].clock)), 2), Ratio.of(spent[name].clock, kernel))
    return report


def needed_operations(settings: PaperSettings, headings: int, places: int) -> float:
    """Additions and multiplications that the votes need with two filters and Gram matrices known beforehand.

    Reading and mean; right sides; then for each step of trimming residuals, half of the symmetric products of the pixels left out
    (with what was observed as further column), and a Cholesky solution; at last the products with the places. Comparisons, selection
    and all copying count nothing.
    """
    n, p = settings.pixels, settings.components
    rows = 2 * n
    work = 4.0 * rows + 2.0 * rows * p
    count = n
    while count > settings.trim_to:
        survivors = max(settings.trim_to, int(count * settings.trim_keep))
        work += 2.0 * (2 * count) * p + 3.0 * (2 * count)
        work += 2 * (count - survivors) * (p + 1.0) * (p + 2.0)
        work += p**3 / 3.0 + 2.0 * p**2
        count = survivors
    return headings * settings.hypotheses * (work + 2.0 * p * p + 2.0 * places * p)


def tasks_of(panorama_map: PanoramaMap, panorama: Panorama, settings: PaperSettings) -> dict[str, Callable[[], Array]]:
    """The kernel as the model calls it, and NumPy: as the paper says, in both precisions, and by the kernel's own short cuts."""
    model = PaperModel.build(panorama_map.references, settings)
    arguments = model.kernel_arguments(panorama.pixels, np.radians(HEADINGS_DEG))
    plain = _Plain(model, panorama_map.references.pixels, panorama, settings)
    return {
        KERNEL: lambda: np.asarray(vote(*arguments)),
        "NumPy, three filters, float64": plain.task(filter_bank, np.float64, False),
        "NumPy, three filters, float32": plain.task(filter_bank, np.float32, False),
        "NumPy by the kernel's short cuts: two basis filters, downdating, float32": plain.task(
            lambda image: basis_responses(image, "gradients"), np.float32, True
        ),
    }


def plain_votes(panorama_map: PanoramaMap, panorama: Panorama, settings: PaperSettings) -> Callable[[], Array]:
    """The paper's voting as it is printed, in plain NumPy: a call gives the votes for five headings."""
    model = PaperModel.build(panorama_map.references, settings)
    return _Plain(model, panorama_map.references.pixels, panorama, settings).task(filter_bank, np.float64, False)


class _Plain:
    """What the paper's voting needs of a map and an image, for any filters and precision."""

    def __init__(self, model: PaperModel, images: Array, panorama: Panorama, settings: PaperSettings) -> None:
        self.shape, self.panorama, self.settings = panorama.pixels.shape, panorama, settings
        flat = images.reshape(len(images), -1).astype(np.float32)
        self.mean = flat.mean(axis=0)
        self.eigenspace = principal_components(flat - self.mean, settings.components, "components")
        coefficients = self.eigenspace.coefficients
        self.coefficients = coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)
        self.rows, self.columns = (model.arrays()[name] for name in ("rows", "columns"))

    def task(self, filters: Filters, dtype: type, downdate: bool) -> Callable[[], Array]:
        """A call that votes."""
        rows, columns, settings = self.rows, self.columns, self.settings
        filtered = np.stack([filters(image.reshape(self.shape)) for image in self.eigenspace.eigenimages], axis=-1)
        design: Array = np.ascontiguousarray(np.moveaxis(filtered[:, rows, columns], 0, 2), dtype=dtype)
        mean = filters(self.mean.reshape(self.shape))[:, rows, columns]
        means: Array = np.ascontiguousarray(np.moveaxis(mean, 0, 2), dtype=dtype)
        seen: Array = filters(self.panorama.pixels).astype(dtype)
        grams = np.einsum("mntj,mntk->mjk", design, design, dtype=np.float64).astype(dtype)
        shifts = HEADINGS_DEG * self.shape[1] / 360.0
        tail = (self.coefficients.astype(dtype), shifts, settings.trim_keep, settings.trim_to, settings.vote_width)
        return lambda: vote_batched(seen, rows, columns, design, means, *tail, downdate=downdate, grams=grams)

"""Section of ``benchmark.py`` on the paper's voting: against plain NumPy, and as a share of what the machine can multiply."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.peers.linear_filters import basis_responses, filter_bank
from panoloc_mcl.laboratory.peers.paper import PaperModel
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.pca import principal_components
from panoloc_mcl.robot.kernels.voting import vote
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.datasets import Dataset, read_image
from panoloc_mcl.tools.runs.map_cache import cached_map

# The paper's tests, 1000 pixels trimmed to 800 at once, and to 300 step by step.
TRIM_TO = (800, 300)
# Headings around the true one, degrees, as a Kalman filter draws them: M = 5.
HEADINGS_DEG = np.array([-6.3, -2.2, 0.4, 2.9, 7.7])
SQUARE = 1024


def voting(
    dataset: Dataset, repeats: int, interleaved: Callable[[dict[str, Callable[[], object]], int], dict[str, float]]
) -> None:
    """Print the time of the votes for five headings as ratios to NumPy, and the share of the peak; ``interleaved`` takes the times."""
    drive = next(iter(dataset.sequences.values()))
    panorama_map = cached_map(dataset, ObservationSettings(model="paper"), 0)
    references = panorama_map.references
    panorama = panorama_map.unwrapper(drive.camera, drive.image_size)(read_image(drive.files[0]))
    square = np.random.default_rng(0).standard_normal((SQUARE, SQUARE)).astype(np.float32)
    for trim_to in TRIM_TO:
        settings = PaperSettings(trim_to=trim_to)
        model = PaperModel.build(references, settings)
        tasks = {**_tasks(model, references.pixels, panorama, settings), "peak": lambda: square @ square}
        votes = {name: task() for name, task in tasks.items() if name != "peak"}
        kernel = next(iter(votes))
        for name, found in votes.items():
            # The same computation: single precision may trim another pixel here and there.
            assert np.abs(found - votes[kernel]).max() < 0.01, name
        medians = interleaved(tasks, repeats)
        places, p = len(references), settings.components
        print(
            f"\n## The paper's voting: {len(HEADINGS_DEG)} headings x {settings.hypotheses} hypotheses x {settings.pixels} pixels "
            f"trimmed to {trim_to}, p = {p}, {places} places\n"
        )
        print("From filter responses to votes, one thread.\n\n| what | ms | times as long |\n|---|---|---|")
        for name in votes:
            print(f"| {name} | {1e3 * medians[name]:.2f} | {medians[name] / medians[kernel]:.1f} |")
        work = needed_operations(settings, len(HEADINGS_DEG), places)
        rate, peak = work / medians[kernel], 2.0 * SQUARE**3 / medians["peak"]
        print(
            f"\n{1e-6 * work:.0f} million operations are needed (`needed_operations`): {1e-9 * rate:.1f} GFLOP/s, "
            f"{100.0 * rate / peak:.0f} % of the {1e-9 * peak:.0f} GFLOP/s of float32 matrix products ({SQUARE} x {SQUARE}) "
            "in this run."
        )


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


def _tasks(
    model: PaperModel, images: np.ndarray, panorama: Panorama, settings: PaperSettings
) -> dict[str, Callable[[], np.ndarray]]:
    """The kernel as the model calls it, and NumPy: as the paper says, in both precisions, and by the kernel's own short cuts."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from oracles.kernels import vote_batched

    shape = panorama.pixels.shape
    flat = images.reshape(len(images), -1).astype(np.float32)
    mean = flat.mean(axis=0)
    eigenspace = principal_components(flat - mean, settings.components, "components")
    coefficients = eigenspace.coefficients / np.linalg.norm(eigenspace.coefficients, axis=1, keepdims=True)
    rows, columns = (model.arrays()[name] for name in ("rows", "columns"))
    shifts = HEADINGS_DEG * shape[1] / 360.0

    def numpy(filters: Callable[[np.ndarray], np.ndarray], dtype: type, downdate: bool) -> Callable[[], np.ndarray]:
        filtered = np.stack([filters(image.reshape(shape)) for image in eigenspace.eigenimages], axis=-1)
        design = np.ascontiguousarray(np.moveaxis(filtered[:, rows, columns], 0, 2), dtype=dtype)
        means = np.ascontiguousarray(np.moveaxis(filters(mean.reshape(shape))[:, rows, columns], 0, 2), dtype=dtype)
        seen = filters(panorama.pixels).astype(dtype)
        grams = np.einsum("mntj,mntk->mjk", design, design, dtype=np.float64).astype(dtype)
        tail = (coefficients.astype(dtype), shifts, settings.trim_keep, settings.trim_to, settings.vote_width)
        return lambda: vote_batched(seen, rows, columns, design, means, *tail, downdate=downdate, grams=grams)

    def basis(image: np.ndarray) -> np.ndarray:
        return basis_responses(image, "gradients")

    arguments = model.kernel_arguments(panorama.pixels, np.radians(HEADINGS_DEG))
    return {
        "kernel (two basis filters, float32)": lambda: vote(*arguments),
        "NumPy, three filters, float64": numpy(filter_bank, np.float64, False),
        "NumPy, three filters, float32": numpy(filter_bank, np.float32, False),
        "NumPy by the kernel's short cuts: two basis filters, downdating, float32": numpy(basis, np.float32, True),
    }

"""The voting of Steinbauer & Bischof (2004) as printed: sections 2.1 to 2.3 and 3.2.

Where the paper is silent: a hypothesis' "points" are its pixels, each with the responses of all three filters; trimming keeps the
``trim_keep`` best pixels of each step down to ``trim_to`` (Leonardis & Bischof 2000, who go on to 20 p pixels; here by default one
step, because pixels without texture have no residual under any hypothesis and trimming ends up with them alone); the subsets are
drawn once from the seed and shared by all images and headings; votes are divided by the number of hypotheses. Instead of the
three 3x3 filters, the recommended steerable ones can be had (`panoloc_mcl.laboratory.peers.linear_filters`); either bank is computed
from its two basis filters, which gives the same sums of squares.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.linear_filters import basis_responses, filter_size
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.pca import principal_components
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.kernels.voting import vote
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.observation.field import VoteField, silent_field
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas

_ARRAYS = ("rows", "columns", "design", "mean_responses", "references")


class PaperModel:
    """The paper's voting (model ``paper``).

    Parameters
    ----------
    places : Places
    settings : PaperSettings
    image_columns : int
        Columns of a panorama.
    rows, columns : int32 (m, n)
        Pixels of the hypotheses, row by row.
    design : float32 (m, 2, n, p)
        Filtered eigenimages at those pixels (`basis_responses`).
    mean_responses : float32 (m, 2, n)
        Filtered mean image at those pixels.
    references : float32 (k, p)
        Coefficients of the references, of unit length.
    """

    name = "paper"
    gives_heading = True
    draws = True
    notes: tuple[str, ...] = ()

    def __init__(
        self,
        places: Places,
        settings: PaperSettings,
        image_columns: int,
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
        design: NDArray[np.float32],
        mean_responses: NDArray[np.float32],
        references: NDArray[np.float32],
    ) -> None:
        self.places = places
        self.settings = settings
        self._kept = dict(zip(_ARRAYS, (rows, columns, design, mean_responses, references), strict=True))
        self._image_columns = image_columns
        self._rows, self._columns = rows, columns
        equations, self._back = whitened(design.reshape(len(design), -1, design.shape[3]))
        self._transposed, self._by_pixel = in_both_orders(equations, design.shape[2])
        self._mean_responses = mean_responses.reshape(len(design), -1)
        self._references = references.astype(np.float64)
        count = max(1, round(360.0 / settings.heading_step_deg))
        self._headings = 2.0 * np.pi * np.arange(count) / count

    @classmethod
    def build(
        cls, references: ReferencePanoramas, settings: PaperSettings, seed: int = 0, progress: Progress = no_progress
    ) -> Self:
        """Compute the eigenspace, filter it, and draw the pixel subsets from the seed.

        Raises
        ------
        MapError
            Fewer pixels in the images than a hypothesis asks for, filters larger than the images, more eigenimages than the references
            span, or hypotheses with fewer equations than eigenimages.
        """
        count, image_rows, image_columns = references.pixels.shape
        if settings.pixels > image_rows * image_columns:
            raise MapError(
                f"observation.paper.pixels = {settings.pixels}: the references have {image_rows * image_columns} pixels; set fewer"
            )
        if 2 * settings.pixels < settings.components:
            raise MapError(
                f"observation.paper.pixels = {settings.pixels}: the filters give {2 * settings.pixels} independent equations for "
                f"{settings.components} eigenimages; set at least {-(-settings.components // 2)}"
            )
        _check_filters(settings, (image_rows, image_columns))
        images = references.pixels.reshape(count, -1).astype(np.float32)
        mean = images.mean(axis=0)
        eigenspace = principal_components(images - mean, settings.components, "observation.paper.components")
        progress(1, 2, "eigenspace")
        shape = (image_rows, image_columns)
        filtered = np.stack([_filtered(image.reshape(shape), settings) for image in eigenspace.eigenimages], axis=-1)
        filtered_mean = _filtered(mean.reshape(shape), settings)
        rng = np.random.default_rng(seed)
        flat = np.stack(
            [rng.choice(image_rows * image_columns, settings.pixels, replace=False) for _ in range(settings.hypotheses)]
        )
        # Their order does not matter, and in order they are read fastest.
        flat.sort(axis=1)
        rows, columns = (index.astype(np.int32) for index in np.divmod(flat, image_columns))
        coefficients = eigenspace.coefficients
        lengths = np.linalg.norm(coefficients, axis=1, keepdims=True)
        progress(2, 2, "eigenspace")
        return cls(
            Places(references.positions),
            settings,
            image_columns,
            rows,
            columns,
            np.ascontiguousarray(np.moveaxis(filtered[:, rows, columns, :], 0, 1)),
            np.ascontiguousarray(np.moveaxis(filtered_mean[:, rows, columns], 0, 1)),
            np.asarray(coefficients / np.maximum(lengths, 1e-12), dtype=np.float32),
        )

    @classmethod
    def restore(cls, references: ReferencePanoramas, settings: PaperSettings, arrays: Arrays) -> Self:
        """Take up the arrays of a map file."""
        return cls(Places(references.positions), settings, references.geometry.width, *(arrays[name] for name in _ARRAYS))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a map file keeps."""
        return dict(self._kept)

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of one image (see `ObservationModel.observe`)."""
        full_circle = headings is None
        asked = self._headings if headings is None else np.asarray(headings, dtype=np.float64)
        pixels = panorama.pixels
        if float(pixels.max()) - float(pixels.min()) < 1.0:
            return silent_field(asked, self.places, "image has no texture", full_circle)
        votes = vote(*self.kernel_arguments(pixels, asked))
        return VoteField(
            votes.astype(np.float32), asked, self.places, self.settings.tolerance * max(float(votes.max()), 1e-6), full_circle
        )

    def kernel_arguments(self, pixels: NDArray[np.float32], headings: NDArray[np.float64]) -> tuple[Any, ...]:
        """What the kernel `vote` takes for an image (rows, columns) and headings (s,) in radians; apart, so that it can be timed."""
        return (
            _filtered(pixels, self.settings),
            self._rows,
            self._columns,
            self._transposed,
            self._by_pixel,
            self._back,
            self._mean_responses,
            self._references,
            headings * self._image_columns / (2.0 * np.pi),
            self.settings.trim_keep,
            self.settings.trim_to,
            self.settings.vote_width,
        )


def whitened(design: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Equations with orthonormal columns that say the same, hypothesis by hypothesis.

    With G = V diag(w) V^T the Gram matrix of a design, design V / sqrt(w) has orthonormal columns; directions that the equations
    do not determine get the column 0, and so the coefficient 0. Single precision is then enough to solve them.

    Parameters
    ----------
    design : float32 or float64 (m, rows, p)

    Returns
    -------
    equations : same dtype (m, rows, p + 1)
        The last column is 0; the kernels put what is observed there.
    back : same dtype (m, p + 1, p)
        ``coefficients @ back`` are those of the given design.
    """
    m, rows, p = design.shape
    double = design.astype(np.float64)
    values, vectors = np.linalg.eigh(np.swapaxes(double, 1, 2) @ double)
    # Below a hundred thousandth of the largest singular value there is only rounding of single precision.
    known = values > 1e-10 * values[:, -1:]
    scale = np.where(known, 1.0 / np.sqrt(np.where(known, values, 1.0)), 0.0)
    basis = vectors * scale[:, None, :]
    equations, back = np.zeros((m, rows, p + 1), dtype=design.dtype), np.zeros((m, p + 1, p), dtype=design.dtype)
    equations[:, :, :p] = double @ basis
    back[:, :p] = np.swapaxes(basis, 1, 2)
    return equations, back


def in_both_orders(equations: NDArray[Any], pixels: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Equations (m, t n, q) as the kernels want them: transposed (m, q, t n), and pixel by pixel (m, n, t q)."""
    m, _, q = equations.shape
    by_pixel = np.swapaxes(equations.reshape(m, -1, pixels, q), 1, 2).reshape(m, pixels, -1)
    return np.ascontiguousarray(np.swapaxes(equations, 1, 2)), np.ascontiguousarray(by_pixel)


def _filtered(image: NDArray[np.float32], settings: PaperSettings) -> NDArray[np.float32]:
    return basis_responses(image, settings.filters, settings.filter_width_px)


def _check_filters(settings: PaperSettings, shape: tuple[int, int]) -> None:
    size = filter_size(settings.filters, settings.filter_width_px)
    if size <= min(shape):
        return
    found = f"filters of {size} x {size} pixels are larger than the panoramas of {shape[0]} rows x {shape[1]} columns"
    largest = (min(shape) - 1) // 2 / 3.0
    if settings.filters == "gradients" or largest < 1.0:
        raise MapError(f"observation.paper.filters = {settings.filters}: {found}; use larger panoramas")
    raise MapError(
        f"observation.paper.filter_width_px = {settings.filter_width_px:g}: {found}; set at most {np.floor(100 * largest) / 100:g}"
    )

"""The voting of Steinbauer & Bischof (2004) as printed: sections 2.1 to 2.3 and 3.2.

Where the paper is silent: a hypothesis' "points" are its pixels, each with the responses of all three filters; trimming keeps the
``trim_keep`` best pixels of each step down to ``trim_to`` (Leonardis & Bischof 2000, who go on to 20 p pixels; here by default one
step, because pixels without texture have no residual under any hypothesis and trimming ends up with them alone); the subsets are
drawn once from the seed and shared by all images and headings; votes are divided by the number of hypotheses.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.camera import Panorama
from panoloc_mcl.config.model import PaperSettings
from panoloc_mcl.eigenspace.linear_filters import filter_bank
from panoloc_mcl.eigenspace.pca import principal_components
from panoloc_mcl.errors import MapError
from panoloc_mcl.kernels.voting import vote
from panoloc_mcl.observation.base import Arrays
from panoloc_mcl.observation.field import VoteField, silent_field
from panoloc_mcl.observation.places import Places
from panoloc_mcl.progress import Progress, no_progress
from panoloc_mcl.references import ReferencePanoramas

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
        Pixels of the hypotheses.
    design : float32 (m, n, t, p)
        Filtered eigenimages at those pixels.
    mean_responses : float32 (m, n, t)
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
        self._design = design.astype(np.float64)
        self._mean_responses = mean_responses.astype(np.float64)
        self._references = references.astype(np.float64)
        self._grams = np.einsum("mntj,mntk->mjk", self._design, self._design)
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
            Fewer pixels in the images than a hypothesis asks for, or more eigenimages than the references span.
        """
        count, image_rows, image_columns = references.pixels.shape
        if settings.pixels > image_rows * image_columns:
            raise MapError(
                f"observation.paper.pixels = {settings.pixels}: the references have {image_rows * image_columns} pixels; set fewer"
            )
        images = references.pixels.reshape(count, -1).astype(np.float32)
        mean = images.mean(axis=0)
        eigenspace = principal_components(images - mean, settings.components, "observation.paper.components")
        progress(1, 2, "eigenspace")
        shape = (image_rows, image_columns)
        filtered = np.stack([filter_bank(image.reshape(shape)) for image in eigenspace.eigenimages], axis=-1)
        filtered_mean = filter_bank(mean.reshape(shape))
        rng = np.random.default_rng(seed)
        flat = np.stack(
            [rng.choice(image_rows * image_columns, settings.pixels, replace=False) for _ in range(settings.hypotheses)]
        )
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
            np.ascontiguousarray(np.moveaxis(filtered[:, rows, columns, :], 0, 2)),
            np.ascontiguousarray(np.moveaxis(filtered_mean[:, rows, columns], 0, 2)),
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
        votes = vote(
            filter_bank(pixels),
            self._rows,
            self._columns,
            self._design,
            self._grams,
            self._mean_responses,
            self._references,
            asked * self._image_columns / (2.0 * np.pi),
            self.settings.trim_keep,
            self.settings.trim_to,
            self.settings.vote_width,
        )
        return VoteField(
            votes.astype(np.float32), asked, self.places, self.settings.tolerance * max(float(votes.max()), 1e-6), full_circle
        )

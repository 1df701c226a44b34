"""What the cited peers share: which pixels they compare, images that say nothing, and the form of their answer.

None of them knows masks. Rows that the references' camera sees less than half of are left out; elsewhere unseen pixels are black.
Every model gives votes at the headings of the panorama's columns, and other headings are read linearly between them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.settings import (
    BagOfWordsSettings,
    EigenspaceSettings,
    FourierSignatureSettings,
    LeastSquaresSettings,
    NearestReferenceSettings,
    OrientationCorrelationSettings,
    SpinningSettings,
    StructureSettings,
    TemplateMatchingSettings,
    ZeroPhaseSettings,
)
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.observation.field import VoteField, at_headings, silent_field
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

Settings = TypeVar(
    "Settings",
    FourierSignatureSettings,
    EigenspaceSettings,
    LeastSquaresSettings,
    SpinningSettings,
    ZeroPhaseSettings,
    OrientationCorrelationSettings,
    NearestReferenceSettings,
    StructureSettings,
    TemplateMatchingSettings,
    BagOfWordsSettings,
)

# Grey levels at or beyond which a pixel is black or saturated, the least share of others, and the least contrast.
_DARK, _BRIGHT = 2.0, 253.0
_LEAST_USABLE = 0.05
_LEAST_SD = 0.5


class Peer(ABC, Generic[Settings]):
    """An observation model of the literature.

    Parameters
    ----------
    references : ReferencePanoramas
    settings : StrictModel
        Of the model.
    arrays : mapping of str to ndarray
        What `learn` gave.
    """

    name: str
    draws: bool = False
    notes: tuple[str, ...] = ()
    #: False: votes do not depend on the heading, and fields have a single row (see `VoteField.gives_heading`).
    gives_heading: bool = True

    def __init__(self, references: ReferencePanoramas, settings: Settings, arrays: Arrays) -> None:
        self.places = Places(references.positions)
        self.settings: Settings = settings
        self._arrays = dict(arrays)
        self._rows = _rows_seen(references)
        self._columns = references.geometry.width
        self._headings = 2.0 * np.pi * np.arange(self._columns) / self._columns

    @classmethod
    def build(cls, references: ReferencePanoramas, settings: Settings, seed: int = 0, progress: Progress = no_progress) -> Self:
        """Learn from the references.

        Raises
        ------
        MapError
            References without texture, or settings that ask for more than the references give.
        """
        return cls(references, settings, cls.learn(reference_images(references), references, settings, progress))

    @classmethod
    def restore(cls, references: ReferencePanoramas, settings: Settings, arrays: Arrays) -> Self:
        """Take up the arrays of a map file."""
        return cls(references, settings, arrays)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a map file keeps."""
        return dict(self._arrays)

    @classmethod
    @abstractmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: Settings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Everything that voting needs, from the references' images (k, rows, columns)."""

    @abstractmethod
    def votes(self, image: Float32) -> Float32:
        """Votes of one image (rows, columns) at the headings of all columns, float32 (columns, k); (1, k) without heading."""

    def problem(self, image: Float32) -> str:
        """Why an image says nothing; empty when it does."""
        return image_problem(image)

    def observe(self, panorama: Panorama, headings: Float64 | None = None) -> VoteField:
        """Votes of one image (see `ObservationModel.observe`)."""
        full_circle = headings is None or not self.gives_heading
        asked = np.zeros(1) if not self.gives_heading else self._headings if headings is None else np.asarray(headings)
        image = np.ascontiguousarray(panorama.pixels[self._rows], dtype=np.float32)
        problem = self.problem(image)
        if problem:
            return silent_field(asked, self.places, problem, full_circle)
        votes = self.votes(image)
        if not full_circle:
            votes = at_headings(votes, asked)
        tolerance = self.settings.tolerance * max(float(votes.max()), 1e-6)
        return VoteField(votes, asked, self.places, tolerance, full_circle)


def image_problem(image: Float32) -> str:
    """Why a grey-level image says nothing: black, saturated or constant; empty when it does say something."""
    usable = float(np.mean((image > _DARK) & (image < _BRIGHT)))
    if usable < _LEAST_USABLE:
        what = "black" if float(np.median(image)) <= _DARK else "saturated"
        return f"image is {what}: {100.0 * usable:.0f} % of its pixels are usable"
    if float(image.std(dtype=np.float64)) < _LEAST_SD:
        return "image has no texture"
    return ""


def reference_images(references: ReferencePanoramas) -> Float32:
    """The references' grey levels, float32 (k, rows, columns).

    Raises
    ------
    MapError
        References that are black, saturated or constant, one line each.
    """
    pixels = references.pixels if references.valid is None else np.where(references.valid, references.pixels, 0)
    images = pixels[:, _rows_seen(references)].astype(np.float32)
    raise_textureless(references, [bool(image_problem(image)) for image in images])
    return images


def raise_textureless(references: ReferencePanoramas, faulty: list[bool]) -> None:
    """Refuse references that say nothing.

    Raises
    ------
    MapError
        One line for each reference that is ``faulty``.
    """
    if any(faulty):
        raise MapError(
            f"reference {name}: has no texture (black, saturated or constant); take it out of poses.csv"
            for name, bad in zip(references.names, faulty, strict=True)
            if bad
        )


def _rows_seen(references: ReferencePanoramas) -> NDArray[np.bool_]:
    if references.valid is None:
        return np.ones(references.geometry.height, dtype=np.bool_)
    return np.asarray(references.valid.mean(axis=(0, 2)) >= 0.5)

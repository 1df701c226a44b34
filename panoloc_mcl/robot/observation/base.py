"""The one interface of all observation models: an image in, votes over headings and places out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas

Arrays = Mapping[str, NDArray[Any]]


class ObservationModel(Protocol):
    """Turns an image into a vote field. Knows nothing of filters, odometry or time."""

    name: str
    places: Places
    #: False: votes hold at every heading alike, and fields have a single row (see `VoteField.gives_heading`).
    gives_heading: bool
    #: Whether `build` draws random numbers from its seed.
    draws: bool = False
    #: What the user should know of how the map turned out, such as why there are no virtual places.
    notes: tuple[str, ...] = ()

    @classmethod
    def build(cls, references: ReferencePanoramas, settings: Any, seed: int, progress: Progress = no_progress) -> Self:
        """Compute everything that voting needs from the references."""

    @classmethod
    def restore(cls, references: ReferencePanoramas, settings: Any, arrays: Arrays) -> Self:
        """Take up what `arrays` gave when the map was built."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a map file keeps, so that loading computes nothing anew."""

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of one image.

        Parameters
        ----------
        panorama : Panorama
            Canonical, of the references' size.
        headings : float64 (h,), optional
            Radians; None = all around the circle. A model that gives no heading ignores them.
        """

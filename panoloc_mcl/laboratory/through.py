"""An observation model that sees other images than the camera delivers: corrupted, turned, or disturbed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.robot.observation.tracking import Expected, TrackingModel


class SeenThrough(ABC):
    """A model behind something that changes every panorama, whether it is searched for or tracked.

    Parameters
    ----------
    model : ObservationModel
    """

    def __init__(self, model: ObservationModel) -> None:
        self._model = model

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._model, name)

    @abstractmethod
    def seen(self, panorama: Panorama) -> Panorama:
        """What becomes of a panorama."""

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of the panorama as it is seen (see `ObservationModel.observe`)."""
        return self._model.observe(self.seen(panorama), headings)

    def observe_near(self, panorama: Panorama, expected: Expected) -> VoteField:
        """The same where a pose is expected (see `TrackingModel`); a model that does not track searches."""
        seen = self.seen(panorama)
        return self._model.observe_near(seen, expected) if isinstance(self._model, TrackingModel) else self._model.observe(seen)

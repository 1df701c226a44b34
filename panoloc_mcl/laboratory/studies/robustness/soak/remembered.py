"""An observation model that remembers what it answered, so that a million images cost what a few hundred different ones do."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.robot.observation.field import at_headings


class RememberedModel:
    """Answers as the model does, to the last bit; the same image is compared with the map only once.

    An answer depends on nothing but the image and the headings that are asked for. Where headings are asked for, votes at all of the
    model's own headings are kept, and read at those, which is what the model does itself.

    Parameters
    ----------
    model : ObservationModel
        With a heading; whose answers do not depend on what it saw before.
    """

    def __init__(self, model: ObservationModel) -> None:
        self._model = model
        self._anywhere: dict[int, VoteField | ImageError] = {}
        self._by_heading: dict[int, VoteField | ImageError] = {}

    def __getattr__(self, name: str) -> Any:
        # Where a pose is expected, the answer depends on that, too, so no image is measured from there.
        if name.startswith("__") or name == "observe_near":
            raise AttributeError(name)
        return getattr(self._model, name)

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of one image (see `ObservationModel.observe`)."""
        key = zlib.crc32(panorama.pixels.tobytes())
        if panorama.valid is not None:
            key = zlib.crc32(panorama.valid.tobytes(), key)
        if headings is None:
            return _answer(self._anywhere, key, lambda: self._model.observe(panorama))
        field = _answer(self._by_heading, key, lambda: self._model.observe(panorama, _all_headings(panorama)))
        if not field.informative:
            return self._model.observe(panorama, headings)
        return VoteField(
            at_headings(field.votes, headings),
            headings,
            field.places,
            field.tolerance,
            full_circle=False,
            at_every_heading=field.at_every_heading,
        )


def _all_headings(panorama: Panorama) -> NDArray[np.float64]:
    return np.linspace(0.0, 2.0 * np.pi, panorama.pixels.shape[1], endpoint=False)


def _answer(kept: dict[int, VoteField | ImageError], key: int, ask: Callable[[], VoteField]) -> VoteField:
    if key not in kept:
        try:
            kept[key] = ask()
        except ImageError as error:
            kept[key] = error
    found = kept[key]
    if isinstance(found, ImageError):
        raise found
    return found

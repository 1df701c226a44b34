"""The data set that the figures are drawn from, with the maps of both models, and its images at known poses."""

from __future__ import annotations

import sys
from functools import cached_property
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.peers.paper import PaperModel
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.laboratory.studies.single_images import Frame, Viewer, frames_of
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.runs.map_cache import cached_map

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

    @cached_property
    def frames(self) -> dict[str, list[Frame]]:
        """Every image with ground truth, by light."""
        return frames_of(self.dataset)

    def nearest(self, light: str, position: FloatArray) -> Frame:
        """The image of a light that was taken nearest to a position."""
        return min(self.frames[light], key=lambda frame: float(np.hypot(*(frame.truth[:2] - position))))

    def panorama(self, frame: Frame) -> Panorama:
        """An image as the map compares it."""
        return Viewer(self.map).panorama(frame)

    def upright(self, frame: Frame) -> FloatArray:
        """An image turned to heading 0, by whole columns; float (rows, columns)."""
        return np.asarray(turned(self.panorama(frame).pixels, float(frame.truth[2])), dtype=np.float64)


def turned(pixels: Any, heading: float) -> Any:
    """A panorama that was taken at a heading, as one at heading 0 would have been, to whole columns."""
    # Columns run clockwise, headings counter-clockwise.
    return np.roll(pixels, -round(heading * pixels.shape[1] / (2.0 * np.pi)), axis=1)

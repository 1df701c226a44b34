"""How a map reads images that it was not made of, and its own as though they had never been taken."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VoteField, VotesModel

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Keyframes of the map that are held out, one by one.
_SAMPLED = 8
# An image is read rightly within this of where it was taken.
_RIGHT_M, _RIGHT_RAD = 0.25, np.radians(10.0)
# A map may read this much worse than another before it is.
_WORSE, _WORSE_M = 1.1, 0.002
# One image in so many may be lost: a larger map has more places that look alike.
_ONE_IN = 8


def usual_agreement(panorama_map: PanoramaMap) -> float:
    """Agreement of the map's own keyframes with views made from their neighbours, the median of a few held out."""
    fields = _read_without_itself(panorama_map, spread_over(used_keyframes(panorama_map)))
    found = [field.measurement.agreement.cosine for field in fields if field.measurement is not None]
    return float(np.median(found)) if found else 0.0


def used_keyframes(panorama_map: PanoramaMap) -> Int64:
    """Indices of the keyframes that the map's views are made from; none where it makes none."""
    used = panorama_map.arrays.get("used")
    return np.zeros(0, dtype=np.int64) if used is None else np.asarray(used, dtype=np.int64)


def spread_over(indices: Int64) -> Int64:
    """A few of them, evenly."""
    return indices[np.unique(np.linspace(0, len(indices) - 1, min(len(indices), _SAMPLED)).round().astype(np.int64))]


def _read_without_itself(panorama_map: PanoramaMap, indices: Int64) -> Iterator[VoteField]:
    """What the map makes of keyframes of its own, each as though it had never been taken."""
    model = panorama_map.observation_model()
    if isinstance(model, VotesModel):
        for index, place in zip(indices, np.searchsorted(used_keyframes(panorama_map), indices), strict=True):
            yield model.held_out(int(place)).observe(panorama_map.references.panorama(int(index)))


@dataclass(frozen=True)
class Judgement:
    """How a map reads images that it was not made of: metres they are off, infinite where they are not read rightly."""

    metres: Float64

    @classmethod
    def of(cls, found: Float64, expected: Float64) -> Self:
        """From poses (n, 3) as they were read, NaN where an image says nothing, and as they are."""
        metres = np.hypot(*(found - expected)[:, :2].T)
        astray = np.isnan(metres) | (np.abs(angle_difference(found[:, 2], expected[:, 2])) > _RIGHT_RAD)
        return cls(np.where(astray, np.inf, metres))

    @property
    def right(self) -> int:
        """How many are read rightly."""
        return int(np.sum(self.metres < _RIGHT_M))

    @property
    def median_m(self) -> float:
        """How far these are off in the median, metres."""
        return float(np.median(self.metres[self.metres < _RIGHT_M])) if self.right else _RIGHT_M

    def is_worse_than(self, before: Judgement) -> bool:
        """Fewer images are read rightly, beyond one in so many, or those less exactly."""
        lost = before.right - self.right
        return lost > len(self.metres) / _ONE_IN or self.median_m > _WORSE * before.median_m + _WORSE_M


def pose_of(field: VoteField) -> Float64:
    """The pose that an image tells, (3,); NaN if it says nothing."""
    if not field.informative:
        return np.full(3, np.nan)
    return field.best_pose if field.measurement is None else field.measurement.pose


def of_keyframes(panorama_map: PanoramaMap, names: list[str]) -> Judgement:
    """Of keyframes that the map had before."""
    indices = np.array(sorted(panorama_map.references.names.index(name) for name in names), dtype=np.int64)
    poses = np.pad(panorama_map.references.positions, ((0, 0), (0, 1)))
    found = [pose_of(field) for field in _read_without_itself(panorama_map, indices)]
    return Judgement.of(np.array(found).reshape(-1, 3), poses[indices])

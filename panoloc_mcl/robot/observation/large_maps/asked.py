"""Which places an image is compared with, where a map has too many to ask them all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

Int64 = NDArray[np.int64]
Float32 = NDArray[np.float32]

#: A map of so many places at most asks them all.
MOST_DENSE = 8000
#: Places that stand for all others, evenly over the map.
SPREAD = 256


@dataclass(frozen=True, eq=False)
class Asked:
    """The columns of a vote field that has not all places.

    The first ones are the places that may be right. The others are spread evenly over the map and stand for all that were not asked:
    by them the field knows what the image gives to a place on the mean, and how much that varies.

    Parameters
    ----------
    places : int64 (c,)
        Of the columns; each place once.
    likely : int
        How many of them may be right.
    of : int
        Places of the map, k.
    """

    places: Int64
    likely: int
    of: int

    @classmethod
    def among(cls, likely: Int64, spread: Int64, of: int) -> Self:
        """Of places that may be right, each once, and those that stand for the others, which may be among them."""
        others = spread[~np.isin(spread, likely)]
        return cls(np.concatenate([likely, others]), len(likely), of)

    @cached_property
    def columns(self) -> NDArray[np.int32]:
        """Column of every place, int32 (k,), in what is `readable`; c for the places that were not asked."""
        columns = np.full(self.of, len(self.places), dtype=np.int32)
        columns[self.places] = np.arange(len(self.places))
        return columns

    @cached_property
    def stands_for(self) -> Float32:
        """How many places each column stands for, float32 (c,), k together."""
        others = len(self.places) - self.likely
        shares = np.ones(len(self.places), dtype=np.float32)
        if others:
            shares[self.likely :] = (self.of - self.likely) / others
        return shares

    def readable(self, votes: Float32) -> Float32:
        """Votes (h, c), and one more column: what a place that was not asked gets, the mean of those that stand for it.

        It is hardly ever anything else: votes of a wrong place at a heading spread little about their mean, far below those of a right
        one. Nothing at all would pull down the votes of the places next to it, as particles are read between places.
        """
        others = votes[:, self.likely :]
        rest = others.mean(axis=1, keepdims=True) if others.shape[1] else np.zeros((len(votes), 1), dtype=np.float32)
        return np.hstack([votes, rest])


def evenly(count: int, places: int) -> Int64:
    """So many of so many places, evenly in their order, which is that of the rows of a grid."""
    return np.unique(np.linspace(0, places - 1, min(count, places)).round().astype(np.int64))

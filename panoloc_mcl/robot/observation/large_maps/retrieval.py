"""Retrieval, then votes: all places are ranked by a short code, and the best of them are voted on with all eigenimages.

The code of a place is its first 128 coefficients, each over its usual size over all places, and its rank is that of the cosine at the
best of headings five degrees apart. That is one matrix product over all places, which at a hundred thousand of them takes about as
long as what comes after. An approximate index (faiss, usearch) would have to be asked once for each heading, as a turned image has
another code, and would be one more library on the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.observation.calibration import CONDITIONS, DIM, dark_and_noisy
from panoloc_mcl.robot.observation.correlator import Correlator
from panoloc_mcl.robot.observation.large_maps.asked import SPREAD, Asked, evenly
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.unfinished import Parts

Int64 = NDArray[np.int64]
Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]

# So many places at least, and at most, whatever held-out references say. Of a map of 9,370 places that was to retrieve 256, confidence
# told right poses from wrong ones less well than with 3764 (log loss .29, not .17): of noisy images, held-out references are not asked.
_FEWEST, _MOST = 1024, 4096
# The true place is missed by less than one image in a thousand, if the logarithms of its ranks are normally distributed, ...
_DEVIATIONS = 3.09
# ... and if the worst of the ranks that were seen is not far from the worst there is.
_TIMES_THE_WORST = 4
# References that are held out, for each one that a calibration holds out.
_TIMES_AS_MANY = 4
# But for images half of whose pixels are noise: of those, the code of few eigenimages knows far less than all of them.
_CONDITIONS = (*(condition for condition in CONDITIONS if condition is not dark_and_noisy), DIM)
# The best votes are the true place's, or its neighbour's.
_FOUND_IN_SPACINGS = 2.0
# While tracking: places around the robot, so many spacings far, and those that stand for the rest.
_NEAR_IN_SPACINGS, _GLANCED_AT = 8.0, 1024
_NOTHING_KEPT = Parts()


@dataclass(frozen=True, eq=False)
class Retrieval:
    """Chooses the places of a large map that an image is compared with.

    Parameters
    ----------
    correlator : Correlator
        Of all places.
    places : Places
    count : int
        How many are voted on.
    """

    correlator: Correlator
    places: Places
    count: int = _MOST

    def votes(self, z: Complex64, usable: NDArray[np.bool_], width: float) -> tuple[NDArray[np.float32], Asked]:
        """Votes of an image for every heading and the retrieved places, float32 (columns, c), and which these are."""
        turned = self.correlator.projections(z)
        asked = self.asked(turned)
        return self.correlator.at(asked.places).votes(z, usable, width, turned), asked

    def asked(self, turned: Complex64) -> Asked:
        """The places that an image is compared with, from its `Correlator.projections`."""
        likeness = self.correlator.likeness(turned)
        return Asked.among(_best(likeness, self.count), self._spread, len(likeness))

    def near(self, position: Float64) -> Asked:
        """The places around a position (2,) and some all over the map, so many on all maps: what tracking glances at."""
        around = np.sort(self.places.within(position, _NEAR_IN_SPACINGS * self.places.spacing))
        return Asked.among(around, self._glanced_at, len(self.places))

    def rank(self, z: Complex64, usable: NDArray[np.bool_], width: float, place: int) -> int | None:
        """How many places are ranked before one; None where votes would not find it either, however many places were retrieved."""
        turned = self.correlator.projections(z)
        likeness = self.correlator.likeness(turned)
        asked = np.union1d(_best(likeness, _MOST), [place])
        found = asked[np.argmax(self.correlator.at(asked).votes(z, usable, width, turned).max(axis=0))]
        away = np.hypot(*(self.places.positions[found] - self.places.positions[place]))
        if away > _FOUND_IN_SPACINGS * self.places.spacing:
            return None
        return int(np.count_nonzero(likeness > likeness[place]))

    @cached_property
    def _spread(self) -> Int64:
        return evenly(SPREAD, len(self.places))

    @cached_property
    def _glanced_at(self) -> Int64:
        return evenly(_GLANCED_AT, len(self.places))


class HeldOut(Protocol):
    """A model that lacks one reference."""

    def rank(self, panorama: Panorama, position: Float64) -> int | None:
        """Of the place nearest to a position (2,)."""


def learned_count(
    held_out: Callable[[int], HeldOut],
    references: ReferencePanoramas,
    most_references: int,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> int:
    """How many places a map must retrieve, learnt from references that are held out one by one (see `enough`).

    Parameters
    ----------
    held_out : callable (index) -> model
        The model as though this reference had never been taken.
    references : ReferencePanoramas
    most_references : int
        As in `calibrate`; here some times as many, as only ranks are asked for.
    progress : callable (done, total, what)
    threads : int
        References at work at once; the result does not depend on it.
    parts : Parts
        Where what is done is kept.
    """
    chosen = evenly(_TIMES_AS_MANY * most_references, len(references))

    def ranks_of(number: int) -> Iterator[tuple[int]]:
        index = int(chosen[number])
        model, position = held_out(index), references.positions[index]
        for panorama in _images_of(references, index):
            rank = model.rank(panorama, position)
            if rank is not None:
                yield (rank,)

    ranks = parts.listed("retrieval", len(chosen), 4 * threads, ranks_of, threads, progress)
    return enough(ranks[0].tolist() if ranks else [])


def _images_of(references: ReferencePanoramas, index: int) -> Iterator[Panorama]:
    """A reference at random headings, as it is, occluded, and in another light."""
    for number, condition in enumerate(_CONDITIONS):
        rng = np.random.default_rng([index, number])
        shift = int(rng.integers(references.geometry.width))
        pixels = np.ascontiguousarray(np.roll(references.pixels[index], -shift, axis=1))
        seen = None if references.valid is None else np.roll(references.valid[index], -shift, axis=1)
        yield Panorama((pixels if condition is None else condition(pixels, rng)).astype(np.float32), seen)


def _best(likeness: NDArray[np.float32], count: int) -> Int64:
    """So many places that are most alike, by rising index."""
    others = max(len(likeness) - count, 0)
    return np.sort(np.argpartition(likeness, others)[others:]) if others else np.arange(len(likeness))


def enough(ranks: Sequence[int]) -> int:
    """How many places must be retrieved so that less than one image in a thousand misses the true one.

    Parameters
    ----------
    ranks : sequence of int
        Of the true place, by images of held-out references; 0 is the first.
    """
    if not ranks:
        return _MOST
    logarithms = np.log1p(np.asarray(ranks, dtype=np.float64))
    usual = float(np.exp(logarithms.mean() + _DEVIATIONS * logarithms.std()))
    return int(np.clip(np.ceil(max(usual, _TIMES_THE_WORST * (1.0 + max(ranks)))), _FEWEST, _MOST))

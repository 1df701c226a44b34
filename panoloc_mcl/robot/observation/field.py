"""The vote field: what one image says about every heading at every place. A particle is a look-up in it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.kernels.filtering.particles import likelihoods_there, read_field
from panoloc_mcl.robot.kernels.filtering.weights import likelihoods, sums_of_likelihoods
from panoloc_mcl.robot.measurement import PoseMeasurement
from panoloc_mcl.robot.observation.large_maps.asked import MOST_DENSE, SPREAD, Asked, evenly
from panoloc_mcl.robot.observation.peaks import Guess, Peak
from panoloc_mcl.robot.observation.places import Places

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

# A rival is somewhere else: at least this far from the best cell, in place spacings or in degrees.
_RIVAL_SPACINGS = 1.6
_RIVAL_DEG = 20.0
# Votes change little from one degree to the next: so many headings are enough for the mean likelihood of a field.
_HEADINGS = 90
_EVERY_PLACE = np.zeros(0, dtype=np.int32)


@dataclass(frozen=True, eq=False)
class VoteField:
    """Votes over headings and places.

    Parameters
    ----------
    votes : float32 (h, c)
        In [0, 1].
    headings : float64 (h,)
        Radians. Either equally spaced over the circle from 0, or those that were asked for. A single one over the full circle: the
        votes hold at every heading.
    places : Places
        The k places of the map.
    tolerance : float
        Standard deviation of how far the votes at the true pose fall short of the best ones.
    full_circle : bool
        The headings are equally spaced over the circle, so the field can be read anywhere.
    problem : str
        Why the image cannot be used; empty if it can. Either it carries no information ("image is black") and all votes are 0,
        or it fits nowhere.
    measurement : PoseMeasurement or None
        The pose that the image gives by itself, when the model refines the best cell.
    confidence : float
        Probability that the best pose (refined, if it is) is right; NaN where the model does not know.
    at_every_heading : float32 (n,) or None
        Where only some headings were asked for: the best votes at n headings equally spaced over the circle from 0; None where the
        model does not know.
    asked : Asked or None
        The places that the c columns are of, where the map has too many to ask them all; None: of all, in order.
    noisy : bool
        The image shows more noise than world (see `eigenspace.gradients.quiet`).
    """

    votes: Float32
    headings: Float64
    places: Places
    tolerance: float
    full_circle: bool = True
    problem: str = ""
    measurement: PoseMeasurement | None = None
    confidence: float = float("nan")
    at_every_heading: Float32 | None = None
    asked: Asked | None = None
    noisy: bool = False

    @property
    def informative(self) -> bool:
        """Whether the image says anything."""
        return not self.problem

    @property
    def doubt(self) -> float:
        """Probability that the best pose is wrong; 0 where the model does not know."""
        return 0.0 if np.isnan(self.confidence) else 1.0 - self.confidence

    @property
    def gives_heading(self) -> bool:
        """Whether votes depend on the heading; if not, they hold at every heading alike."""
        return not self.full_circle or len(self.headings) > 1

    @property
    def best_at_any_heading(self) -> float:
        """The best votes at any heading, where only some were asked for; NaN where the model does not know."""
        return math.nan if self.at_every_heading is None else float(self.at_every_heading.max())

    @property
    def best_elsewhere(self) -> float:
        """The best votes at headings far from all that were asked for; NaN where the model does not know, 0 where there are none."""
        if self.at_every_heading is None:
            return math.nan
        around = np.arange(len(self.at_every_heading)) * (2.0 * np.pi / len(self.at_every_heading))
        far = (np.abs(angle_difference(around[:, None], self.headings)) > np.radians(_RIVAL_DEG)).all(axis=1)
        return float(self.at_every_heading[far].max(initial=0.0))

    def read(self, poses: Float64) -> Float32:
        """Votes at poses (n, 3), interpolated over heading and place; 0 off the map. float32 (n,)."""
        return self.read_compact(CompactPoses.of(poses, self.places.raster.origin))

    def read_compact(self, poses: CompactPoses) -> Float32:
        """The same for particles."""
        return read_field(*poses.arrays, *self._raster_from(poses.origin))

    def read_likelihood(self, poses: CompactPoses, sharpness: float, floor: float, out: Float32) -> None:
        """`likelihood` of the votes at particles (n,), into float32 (n,)."""
        scale = (self.peak.votes, self.tolerance, sharpness, floor)
        likelihoods_there(*(*poses.arrays, *self._raster_from(poses.origin), *scale, out))

    def _raster_from(self, origin: Float64) -> tuple[Any, ...]:
        raster = self.places.raster
        x, y = raster.origin[0] - float(origin[0]), raster.origin[1] - float(origin[1])
        columns = _EVERY_PLACE if self.asked is None else self.asked.columns
        looked_up = self._readable, columns, raster.neighbours, raster.weights
        return *looked_up, x, y, raster.cell, raster.shape[1], raster.shape[0]

    @cached_property
    def _readable(self) -> Float32:
        return self.votes if self.asked is None else self.asked.readable(self.votes)

    def _column(self, places: Any) -> Any:
        """Columns of places in what is readable."""
        return places if self.asked is None else self.asked.columns[places]

    def _place(self, columns: Any) -> Any:
        """Places of columns."""
        return columns if self.asked is None else self.asked.places[columns]

    @property
    def best_of_places(self) -> Float32:
        """The most votes of every place of the map at any heading, float32 (k,)."""
        return np.asarray(self._readable.max(axis=0)[self._column(slice(None))])

    def votes_at(self, pose: Float64) -> float:
        """What `read` gives for one pose (3,), without the raster, which a field of few questions need not have."""
        neighbours, weights = self.places.around(pose[None, :2])
        rows = at_headings(self._readable[:, self._column(neighbours[0])], np.array([pose[2] % (2.0 * np.pi)]))
        return float(rows[0] @ weights[0])

    def likelihood(self, votes: Float32, sharpness: float = 1.0, floor: float = 0.0) -> Float32:
        """Likelihood of poses that were given so many votes (n,), relative to the best cell: Gaussian in what they fall short of it.

        ``sharpness`` is a power that the Gaussian is taken to, ``floor`` what is left of it where votes are few. float32 (n,).
        """
        return likelihoods(votes, self.peak.votes, self.tolerance, sharpness, floor)

    def mean_likelihood(self, sharpness: float) -> float:
        """Of all headings and places of the map."""
        every = max(1, len(self.headings) // _HEADINGS)
        sums = sums_of_likelihoods(self.votes, every, self.peak.votes, self.tolerance, sharpness)
        found = float(sums.sum() if self.asked is None else sums @ self.asked.stands_for)
        return found / (-(-len(self.votes) // every) * len(self.places))

    @cached_property
    def peak(self) -> Peak:
        """The best heading and place, and its lead over the best rival elsewhere."""
        flat = int(np.argmax(self.votes))
        row, column = divmod(flat, self.votes.shape[1])
        best = float(self.votes[row, column])
        near_heading, near_place = self._near(row, int(self._place(column)))
        rivals = [self.votes.max(axis=1)[~near_heading], self.votes.max(axis=0)[~near_place]]
        rival = max((float(group.max()) for group in rivals if group.size), default=0.0)
        margin = (best - rival) / best if best > 0.0 else 0.0
        return Peak(int(self._place(column)), self._between_headings(row, column), best, margin)

    def best_cells(self, most: int) -> Iterator[tuple[int, int]]:
        """Heading and place of the best cell, then of the best one elsewhere, and so on; at most so many."""
        votes = self.votes.copy()
        for _ in range(most):
            row, column = divmod(int(np.argmax(votes)), votes.shape[1])
            if votes[row, column] <= 0.0:
                return
            place = int(self._place(column))
            yield row, place
            votes[self._around(row, place)] = 0.0

    def _around(self, row: int, place: int) -> tuple[NDArray[Any], ...]:
        """Indices of the cells that are the same place and heading as one cell, roughly."""
        near_heading, near_place = self._near(row, place)
        return np.ix_(np.flatnonzero(near_heading), np.flatnonzero(near_place))

    def _near(self, row: int, place: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Rows and columns that are the same heading, or place, roughly."""
        places = self.places.positions if self.asked is None else self.places.positions[self.asked.places]
        offsets = places - self.places.positions[place]
        near_place = np.hypot(offsets[:, 0], offsets[:, 1]) <= _RIVAL_SPACINGS * self.places.spacing
        return np.abs(angle_difference(self.headings, self.headings[row])) <= np.radians(_RIVAL_DEG), near_place

    def weakened(self, row: int, place: int, factor: float) -> VoteField:
        """The same field with less votes around a cell: a closer look found less there than elsewhere."""
        votes = self.votes.copy()
        votes[self._around(row, place)] *= np.float32(factor)
        return replace(self, votes=votes)

    @cached_property
    def standing_out(self) -> float:
        """How far the best votes lie above the mean of all, in standard deviations of all: of noise, no more than chance gives."""
        mean, spread = float(self.votes.mean()), float(self.votes.std())
        if self.asked is not None:
            shares = self.asked.stands_for / np.float32(len(self.places))
            mean = float(self.votes.mean(axis=0) @ shares)
            spread = float(np.sqrt(np.square(self.votes - np.float32(mean)).mean(axis=0) @ shares))
        # Equal votes differ by rounding alone.
        return (self.peak.votes - mean) / spread if spread > 1e-6 * self.peak.votes else 0.0

    @cached_property
    def best_pose(self) -> Float64:
        """The best cell's pose, between places and headings. float64 (3,).

        Votes peak in a cusp and not in a parabola, which would pull the position towards the grid. On a grid the position is where
        two lines of equal slope through the votes of the neighbours meet (Shimizu & Okutomi 2002); elsewhere it is that of the place.
        """
        peak = self.peak
        heading = 0.0 if np.isnan(peak.heading) else peak.heading
        position = self.places.positions[peak.place]
        row = round(heading * len(self.headings) / (2.0 * np.pi)) % len(self.headings)
        rows = [(row + step) % len(self.headings) for step in ((-1, 0, 1) if self.full_circle else (0,))]
        moved = [self._between_neighbours(position, axis, peak.place, rows) for axis in np.eye(2)]
        return np.array([position[0] + moved[0], position[1] + moved[1], heading])

    def _between_neighbours(self, position: Float64, axis: Float64, place: int, rows: list[int]) -> float:
        """Offset of the peak along an axis of the grid, metres; 0 where there is no neighbour on both sides."""
        spacing = self.places.spacing
        sides = position + spacing * np.outer([-1.0, 1.0], axis)
        neighbours = self.places.nearest(sides)
        if np.any(np.hypot(*(self.places.positions[neighbours] - sides).T) > 0.1 * spacing):
            return 0.0
        beside = self._readable[np.array(rows)[:, None], self._column(neighbours)[None, :]]
        before, after = (float(votes) for votes in beside.max(axis=0))
        here = float(self._readable[rows, self._column(place)].max())
        fall = here - min(before, after)
        return float(np.clip(0.5 * (after - before) / fall, -0.5, 0.5)) * spacing if fall > 0.0 else 0.0

    def _between_headings(self, row: int, column: int) -> float:
        if not self.gives_heading:
            return float("nan")
        heading = float(self.headings[row])
        count = len(self.headings)
        if not self.full_circle or count < 3:
            return heading
        before, here, after = (float(self.votes[(row + step) % count, column]) for step in (-1, 0, 1))
        curvature = before - 2.0 * here + after
        # Top of the parabola through the three headings around the best.
        offset = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
        return float(wrap_angle(heading + offset * 2.0 * np.pi / count))

    @property
    def guess(self) -> Guess | None:
        """The best pose by the image alone, also where it fits nowhere; None where it says nothing or not all headings were asked."""
        if not self.full_circle or not self.peak.votes > 0.0:
            return None
        pose = self.best_pose if self.measurement is None else self.measurement.pose
        return Guess(pose, self._share_of_best if np.isnan(self.confidence) else self.confidence)

    @property
    def _share_of_best(self) -> float:
        likelihood = self.likelihood(self.votes.ravel()).reshape(self.votes.shape)
        if self.asked is not None:
            likelihood *= self.asked.stands_for
        row, column = divmod(int(np.argmax(self.votes)), self.votes.shape[1])
        return float(likelihood[self._around(row, int(self._place(column)))].sum() / likelihood.sum())

    def with_measurement(self, measurement: PoseMeasurement | None) -> VoteField:
        """The same field with the pose that the image gives by itself."""
        return self._but(replace(self, measurement=measurement))

    def judged(self, confidence: float, problem: str) -> VoteField:
        """The same field with its confidence, and with the problem of its image."""
        return self._but(replace(self, confidence=confidence, problem=problem))

    def _but(self, field: VoteField) -> VoteField:
        # What is worked out already holds for it, too.
        known = ("peak", "best_pose", "standing_out")
        field.__dict__.update({name: self.__dict__[name] for name in known if name in self.__dict__})
        return field

    def sample(self, count: int, rng: np.random.Generator) -> Float64:
        """Poses drawn in proportion to the likelihood of the cells, spread over their cell. float64 (count, 3).

        Where the image gives no heading, headings are uniform.
        """
        flat = self.votes.ravel()
        # Cells five standard deviations below the best are hardly ever drawn; leaving them out saves the work of nearly all cells.
        likely = np.flatnonzero(flat >= self.peak.votes - 5.0 * self.tolerance)
        cumulative = np.cumsum(self.likelihood(flat[likely]), dtype=np.float64)
        drawn = np.minimum(np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right"), len(cumulative) - 1)
        rows, columns = np.divmod(likely[drawn], self.votes.shape[1])
        step = 2.0 * np.pi / len(self.headings)
        poses = np.empty((count, 3))
        # A third of a spacing of standard deviation covers the way to the neighbours, whose own votes weigh the result.
        poses[:, :2] = self.places.positions[self._place(columns)] + rng.normal(0.0, 0.35 * self.places.spacing, (count, 2))
        if self.gives_heading:
            poses[:, 2] = wrap_angle(self.headings[rows] + rng.normal(0.0, max(step, np.radians(1.0)), count))
        else:
            poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
        return poses


def at_headings(votes: Float32, headings: Float64) -> Float32:
    """Rows of a field over the full circle at any headings (h,), linear between rows: float32 (h, k)."""
    count = len(votes)
    position = np.asarray(headings) * (count / (2.0 * np.pi))
    lower = np.floor(position).astype(np.int64)
    fraction = (position - lower).astype(np.float32)[:, None]
    return np.asarray((1.0 - fraction) * votes[lower % count] + fraction * votes[(lower + 1) % count], dtype=np.float32)


def silent_field(headings: Float64, places: Places, problem: str, full_circle: bool) -> VoteField:
    """The field of an image that says nothing: all votes 0, and why."""
    asked = None
    if len(places) > MOST_DENSE:
        asked = Asked.among(evenly(1, len(places)), evenly(SPREAD, len(places)), len(places))
    votes = np.zeros((len(headings), len(places if asked is None else asked.places)), dtype=np.float32)
    return VoteField(votes, headings, places, tolerance=1.0, full_circle=full_circle, problem=problem, asked=asked)


def vote_of_cosine(cosines: Float32, width: float) -> Float32:
    """The paper's voting function (eq. 3) of the angle whose cosine is given; 0 for negative cosines.

    Parameters
    ----------
    cosines : float32, any shape
    width : float
        Sigma, radians.

    Returns
    -------
    float32, same shape, in [0, 1]
    """
    angle = np.arccos(np.clip(cosines, 0.0, 1.0))
    return np.asarray(np.exp(angle * angle * np.float32(-0.5 / width**2)), dtype=np.float32)

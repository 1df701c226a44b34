"""The paper's localizer: a Kalman filter on the heading, headings drawn from its prediction, the best response wins.

Steinbauer & Bischof (2004), section 3. The position is that of the reported place; there is no belief over positions. Whether the
places go where odometry leads decides over the status alone (`filters/following.py`). Two filters
work on the one state, as in the fusion method that the paper takes over (its reference 17): odometry turns the predicted heading
whenever it comes, an image corrects it. Both carry their own time stamps. So that they may come in any order, the filter remembers
its last steps: an image that comes late is put in at its own time, and the steps after it are taken again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.base import Start
from panoloc_mcl.robot.filters.estimate import Cluster, FilterState, Status
from panoloc_mcl.robot.filters.following import Following, missed, support_of
from panoloc_mcl.robot.filters.memory import Kept
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.settings.localizer import KalmanSettings, StatusSettings

Float64 = NDArray[np.float64]

# Of a heading of which nothing is known: that of the uniform distribution over the circle.
_SD_UNKNOWN = math.pi / math.sqrt(3.0)
# Steps that are remembered for late images; far more than fall into the odometry that is kept.
_MOST_STEPS = 1000
# Where images have far better votes at other headings than around the prediction, it is wrong: of the best votes right predictions
# keep all but a hundredth on small rendered panoramas, wrong ones a quarter.
_LEAST_SHARE = 0.6


# The form before has nothing of what places do.
_FORM, _FORMS_BEFORE = "kalman_orientation/3", ("kalman_orientation/2",)


@dataclass(frozen=True)
class KalmanMemory(Kept):
    """What a saved state keeps of the filter besides its steps; as its attributes are named."""

    heading: float
    sd_heading: float
    clock: float
    key: int
    drawn: int
    place: int
    place_known: bool
    has_converged: bool
    place_votes: float
    match: float
    share: float


@dataclass(frozen=True)
class _Step:
    """A prediction and, perhaps, a correction at its end.

    Parameters
    ----------
    end : float
        Seconds on the filter's own clock.
    turn, variance : float
        By odometry since the step before, radians and their square.
    measured : float
        Heading that an image gave at the end; NaN when there was none.
    doubt : float
        Variance that this measurement has besides that of all images.
    """

    end: float
    turn: float
    variance: float
    measured: float = math.nan
    doubt: float = 0.0


class KalmanOrientationFilter:
    """Heading by a Kalman filter, place by the best response.

    Parameters
    ----------
    places : Places
    start : Start
        The paper needs the heading; without one the first draws are from all around the circle.
    settings : KalmanSettings
    status : StatusSettings
    rng : numpy.random.Generator
        Gives the key of all random numbers.

    Attributes
    ----------
    heading, sd_heading : float
        The belief, radians.
    """

    def __init__(
        self, places: Places, start: Start, settings: KalmanSettings, status: StatusSettings, rng: np.random.Generator
    ) -> None:
        self.places = places
        self.settings = settings
        self.status_settings = status
        self._key, self._drawn = int(rng.integers(2**63)), 0
        self.heading = 0.0 if start.heading is None else float(wrap_angle(start.heading))
        self.sd_heading = _SD_UNKNOWN if start.heading is None else start.sd_heading
        self._clock = 0.0
        # Time, heading and its standard deviation before the steps that are remembered.
        self._base = (0.0, self.heading, self.sd_heading)
        self._steps: list[_Step] = []
        self._place = 0 if start.position is None else int(places.nearest(np.array([start.position]))[0])
        self._place_known = False
        self._has_converged = False
        self._place_votes = math.nan
        self._match = math.nan
        # Running share of the best votes at any heading that those around the prediction get: low where the heading is wrong.
        self._share = math.nan
        self._following = Following.begun(start.position, start.sd_position)

    def propagate(self, motion: Motion) -> None:
        """Predict the heading from odometry."""
        self._following = self._following.moved(motion, self.heading, self.sd_heading)
        self._clock += motion.duration_s
        step = _Step(self._clock, float(motion.increment[2]), motion.sd_heading**2)
        self.heading, self.sd_heading = _predicted(self.heading, self.sd_heading, step)
        self._steps.append(step)
        while len(self._steps) > _MOST_STEPS:
            oldest = self._steps.pop(0)
            self._base = (oldest.end, *self._passed(*self._base[1:], oldest))

    def heading_hypotheses(self, offset: Motion | None) -> Float64:
        """M headings drawn from the predictive distribution at the image's time."""
        heading, sd = (self.heading, self.sd_heading) if offset is None else self._believed_at(offset)
        sd = max(sd, math.radians(self.settings.min_sd_deg))
        self._drawn += 1
        rng = np.random.Generator(np.random.Philox(key=self._key, counter=[0, 0, 0, self._drawn]))
        return wrap_angle(heading + sd * rng.standard_normal(self.settings.headings))

    def update(self, votes: VoteField, offset: Motion | None = None) -> None:
        """Take the heading and the place of the highest vote as this image's measurement; the place alone if it gives no heading.

        A late image corrects the heading at its own time. Its place is where the robot was then, so it is only taken as long as no
        other is known.
        """
        if offset is None:
            self._following = self._followed(votes)
        self._take_in(votes, offset)
        self._has_converged |= self._is_sure

    def _followed(self, votes: VoteField) -> Following:
        """What the places do after an image; a late one has its place from before."""
        if not votes.informative or votes.peak.votes <= 0.0:
            return self._following.unseen()
        elsewhere = votes.best_elsewhere
        support = 1.0 if math.isnan(elsewhere) else support_of(votes.peak.votes, elsewhere, votes.tolerance)
        unlucky = missed(self.sd_heading, self.settings.headings) if votes.gives_heading else 0.0
        return self._following.seen(votes.peak.place, self.places, support, unlucky)

    def _take_in(self, votes: VoteField, offset: Motion | None) -> None:
        if not votes.informative or votes.peak.votes <= 0.0:
            self._place_votes = self._match = math.nan
            return
        peak = votes.peak
        if offset is None or not self._place_known:
            self._place, self._place_votes, self._place_known = peak.place, peak.votes, True
        if votes.best_at_any_heading > 0.0:
            share = peak.votes / votes.best_at_any_heading
            self._share = share if math.isnan(self._share) else 0.5 * (self._share + share)
        if not votes.gives_heading:
            self._match = math.nan
            return
        if offset is None:
            index = len(self._steps) - 1
            if index < 0 or not math.isnan(self._steps[index].measured):
                self._steps.append(_Step(self._clock, 0.0, 0.0))
                index += 1
            self._steps[index] = replace(self._steps[index], measured=peak.heading)
            self.heading, self.sd_heading, self._match = self._corrected(self.heading, self.sd_heading, self._steps[index])
        else:
            believed = self._believed_at(offset)
            self._match = self._corrected(*believed, _Step(0.0, 0.0, 0.0, peak.heading))[2]
            self._steps = self._with_late(offset, peak.heading)
            self.heading, self.sd_heading = self._replayed(self._steps)

    def _corrected(self, heading: float, sd: float, step: _Step) -> tuple[float, float, float]:
        """Heading and its standard deviation after a measurement, and how well that was expected (1 = exactly)."""
        residual = float(angle_difference(step.measured, heading))
        variance = sd**2
        noise = math.radians(self.settings.measurement_noise_deg) ** 2 + step.doubt
        gain = variance / (variance + noise)
        match = math.exp(-0.5 * residual**2 / (variance + noise))
        return float(wrap_angle(heading + gain * residual)), math.sqrt((1.0 - gain) * variance), match

    def _passed(self, heading: float, sd: float, step: _Step) -> tuple[float, float]:
        """The belief after a step from that before it."""
        heading, sd = _predicted(heading, sd, step)
        return (heading, sd) if math.isnan(step.measured) else self._corrected(heading, sd, step)[:2]

    def _replayed(self, steps: list[_Step]) -> tuple[float, float]:
        _, heading, sd = self._base
        for step in steps:
            heading, sd = self._passed(heading, sd, step)
        return heading, sd

    def _believed_at(self, offset: Motion) -> tuple[float, float]:
        """Prediction for the time of a late image, from what had happened up to then."""
        time = self._clock + offset.duration_s
        if time < self._base[0]:
            turn, doubt = self._after(offset, self._steps)
            return float(wrap_angle(self._base[1] - turn)), min(math.hypot(self._base[2], math.sqrt(doubt)), _SD_UNKNOWN)
        return self._replayed([step for step in self._with_late(offset, math.nan) if step.end <= time])

    def _with_late(self, offset: Motion, measured: float) -> list[_Step]:
        """The remembered steps with a measurement put in at its own time; one from before them all is brought on to their beginning.

        The step that it falls into is cut in two: its turn where odometry says, its variance so that what follows the cut has as
        much as the way back has.
        """
        steps, time = self._steps, self._clock + offset.duration_s
        if time < self._base[0]:
            turn, doubt = self._after(offset, steps)
            return [_Step(self._base[0], 0.0, 0.0, float(wrap_angle(measured + turn)), doubt), *steps]
        index = next(i for i, step in enumerate(steps) if step.end >= time)
        cut, later = steps[index], steps[index + 1 :]
        turn, variance = self._after(offset, later)
        variance = min(variance, cut.variance)
        before = _Step(time, cut.turn - turn, cut.variance - variance, measured)
        return [*steps[:index], before, replace(cut, turn=turn, variance=variance), *later]

    @staticmethod
    def _after(offset: Motion, steps: list[_Step]) -> tuple[float, float]:
        """Turn and its variance from the time of a late image to the beginning of the last steps."""
        turn = wrap_angle(-offset.increment[2] - math.fsum(step.turn for step in steps))
        return float(turn), max(offset.sd_heading**2 - math.fsum(step.variance for step in steps), 0.0)

    def particles(self) -> tuple[Float64, Float64]:
        """None."""
        return np.zeros((0, 3)), np.zeros(0)

    def snapshot(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """All that the next step depends on: arrays, and a header of plain values."""
        steps = np.array([astuple(step) for step in self._steps]).reshape(-1, 5)
        memory = KalmanMemory(
            heading=self.heading,
            sd_heading=self.sd_heading,
            clock=self._clock,
            key=self._key,
            drawn=self._drawn,
            place=self._place,
            place_known=self._place_known,
            has_converged=self._has_converged,
            place_votes=self._place_votes,
            match=self._match,
            share=self._share,
        )
        arrays = {"steps": steps, "base": np.array(self._base), "following": self._following.array()}
        return arrays, memory.header(_FORM)

    def restore(self, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave, of this version or of one before.

        Raises
        ------
        KeyError, ValueError
            Something is missing, of another form, or of another shape.
        """
        form = header.get("form")
        memory = KalmanMemory.of_header(header, form if form in _FORMS_BEFORE else _FORM)
        if not 0 <= memory.place < len(self.places):
            raise ValueError(f"place {memory.place} of {len(self.places)}")
        if form in _FORMS_BEFORE:
            at = tuple(self.places.positions[memory.place].tolist())
            following = Following.begun(at if memory.place_known else None, self.places.spacing)
        else:
            following = Following.of_array(arrays["following"])
        time, heading, sd = (float(value) for value in arrays["base"])
        steps = [_Step(*(float(value) for value in row)) for row in arrays["steps"]]
        self._base, self._steps, self._following = (time, heading, sd), steps, following
        self.heading, self.sd_heading, self._clock = memory.heading, memory.sd_heading, memory.clock
        self._key, self._drawn = memory.key, memory.drawn
        self._place, self._place_known, self._has_converged = memory.place, memory.place_known, memory.has_converged
        self._place_votes, self._match, self._share = memory.place_votes, memory.match, memory.share

    @property
    def _is_sure(self) -> bool:
        limits = self.status_settings
        narrow = math.degrees(self.sd_heading) < limits.converged_spread_deg
        # Not a number where the model does not know: then the filter cannot, either.
        fits = self._place_known and not self._share < _LEAST_SHARE
        return narrow and fits and self._following.right > 1.0 - limits.lost_chance and self._is_on_track

    @property
    def _is_on_track(self) -> bool:
        """Whether the reported place is where odometry leads from those before: one that is not may be wrong, or long past."""
        track, limit = self._following, self.status_settings.converged_spread_m
        off = math.hypot(*(self.places.positions[self._place] - track.position).tolist())
        # Half a cell's diagonal is the place's own.
        return track.spread_m < limit and off < limit + self.places.spacing / math.sqrt(2.0)

    def state(self) -> FilterState:
        """The reported place with the filtered heading, as one cluster; asking changes nothing."""
        position = self.places.positions[self._place]
        # Somewhere in the place's cell: a uniform distribution over one spacing.
        sd_position = self.places.spacing / math.sqrt(12.0)
        if not self._place_known:
            extent = np.ptp(self.places.positions, axis=0).max() if len(self.places) > 1 else self.places.spacing
            sd_position = float(extent) / math.sqrt(12.0)
        cluster = Cluster(
            np.array([position[0], position[1], self.heading]),
            np.diag([sd_position**2, sd_position**2, self.sd_heading**2]),
            1.0,
        )
        unsure = Status.LOST if self._has_converged else Status.SEARCHING
        return FilterState(
            clusters=(cluster,),
            status=Status.CONVERGED if self._is_sure else unsure,
            match=self._match,
            best_place=self.places.nearest_reference(position),
            best_place_votes=self._place_votes,
            particle_count=self.settings.headings,
            injected=0,
            effective_count=float(self.settings.headings),
            resampled=False,
            elsewhere=1.0 - self._following.right,
        )


def _predicted(heading: float, sd: float, step: _Step) -> tuple[float, float]:
    return float(wrap_angle(heading + step.turn)), min(math.sqrt(sd**2 + step.variance), _SD_UNKNOWN)

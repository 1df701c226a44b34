"""Whether the places that images give follow odometry: what stands for a tracker that looks only where it expects to be right.

Headings that are drawn from a prediction cannot refute it, however wrong it is: the one that is taken is never far off. The place
can, since it is the best one of the whole map: seen from a right heading it goes where odometry leads; seen from a wrong one it goes
anywhere, or stays where it is. A hidden Markov model (Rabiner 1989) over these cases has a probability for each after every image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation.places import Places

Float64 = NDArray[np.float64]

# Chances between two images: that the robot is carried off; that a heading that was wrong comes right by itself; that places seen from
# a wrong heading begin to stay where they are, or to change again, which they do not while the robot stands.
_CARRIED_OFF, _REGAINED, _CHANGED = 0.01, 0.003, 0.02
# Share of images whose place, or whose votes for the heading, say nothing even where the heading is right.
_GROSS = 0.1
# Scatter of the best place around the robot, in place spacings: its cell, and at times the neighbour's.
_SCATTER = 0.4
# So near a heading must be for its votes to tell the place: the paper's Fig. 4.
_TELLING_DEG = 10.0


@dataclass(frozen=True, eq=False)
class Following:
    """Probabilities of what the places do, and the track that they would follow.

    Parameters
    ----------
    position, covariance : float64 (2,) and (2, 2)
        Of the track, metres; infinite variance before the first place.
    chances : float64 (4,)
        That places follow the track and the heading is *right*; that they follow it and the heading is wrong all the same, as in
        a map that looks alike when *turned*; that they are *anywhere*; that they *stay* where they are.
    place : int
        The last one; -1 before the first.
    way : float
        Driven since then, metres.
    """

    position: Float64
    covariance: Float64
    chances: Float64 = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    place: int = -1
    way: float = 0.0

    @classmethod
    def begun(cls, position: tuple[float, float] | None, sd: float) -> Self:
        """Where a tracker starts.

        Parameters
        ----------
        position : (float, float) or None
            Metres; None: anywhere.
        sd : float
            Of each of its coordinates, metres.
        """
        variance = math.inf if position is None else sd**2
        return cls(np.array((0.0, 0.0) if position is None else position), np.diag([variance, variance]))

    @property
    def right(self) -> float:
        """Probability that the heading is right, and with it the track."""
        return float(self.chances[0])

    @property
    def spread_m(self) -> float:
        """Standard deviation of the track along its longest axis, metres."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance)[-1])) if self._begun else math.inf

    @property
    def _begun(self) -> bool:
        return bool(np.isfinite(self.covariance).all())

    def moved(self, motion: Motion, heading: float, sd_heading: float) -> Self:
        """Led on by odometry from a heading, radians, with its standard deviation."""
        driven = self.way + motion.distance
        if not self._begun:
            return replace(self, way=driven)
        cos, sin = math.cos(heading), math.sin(heading)
        turn = np.array([[cos, -sin], [sin, cos]])
        way = turn @ motion.increment[:2]
        across = np.array([-way[1], way[0]])
        noise = turn @ np.diag([motion.sd_along**2, motion.sd_across**2]) @ turn.T + sd_heading**2 * np.outer(across, across)
        return replace(self, position=self.position + way, covariance=self.covariance + noise, way=driven)

    def unseen(self) -> Self:
        """After an image that says nothing: the robot may have been carried off all the same."""
        gone = _CARRIED_OFF * self.chances[:2]
        return replace(self, chances=self.chances + np.array([*-gone, *2 * [0.5 * gone.sum()]]))

    def seen(self, place: int, places: Places, support: float, missed: float) -> Self:
        """After an image.

        Parameters
        ----------
        place : int
            With the most votes at the headings that were looked at.
        places : Places
        support : float
            How many times as likely its votes are if one of these headings is right as if another one is.
        missed : float
            Chance that none of them was near the true heading although the prediction was right.
        """
        at, luck = places.positions[place], 1.0 / len(places)
        scatter = (_SCATTER * places.spacing) ** 2 * np.eye(2)
        changed = _CHANGED * min(self.way / places.spacing, 1.0)
        begun = replace(self, position=at, covariance=scatter, place=place, way=0.0)
        if not self._begun:
            return replace(begun, chances=self._weighed(support * luck, luck, luck, luck, missed, changed))
        spread = self.covariance + scatter
        nearest = places.positions[places.nearest(self.position[None])[0]]
        led = (1.0 - _GROSS) * _share(place, places, self.position, spread, nearest)
        stays = luck
        if self.place >= 0:
            before = places.positions[self.place]
            stays = (1.0 - _GROSS) * _share(place, places, before, scatter, before) + _GROSS * luck
        # An image whose place has gone wrong says nothing of headings, either.
        right, turned = support * led + _GROSS * luck, led + _GROSS * luck
        chances = self._weighed(right, turned, luck, stays, missed, changed)
        anew = _REGAINED * float(self.chances[2:].sum()) * luck
        if anew > float(self.chances[:2] @ [right, turned]):
            # More probable than that they follow the track so far is that they begin to follow here.
            return replace(begun, chances=chances)
        # The place is the track's with this probability (probabilistic data association, Bar-Shalom 1988).
        ours = led / turned
        gain = self.covariance @ np.linalg.inv(spread)
        step = gain @ (at - self.position)
        covariance = self.covariance - ours * gain @ spread @ gain.T + ours * (1.0 - ours) * np.outer(step, step)
        return replace(begun, chances=chances, position=self.position + ours * step, covariance=covariance)

    def _weighed(self, right: float, turned: float, luck: float, stays: float, missed: float, changed: float) -> Float64:
        """The probabilities of the cases once an image is seen, float64 (4,), from its likelihood in each of them."""
        before = self.chances.tolist()
        lost, wrong = 1.0 - (1.0 - _CARRIED_OFF) * (1.0 - missed), before[2] + before[3]
        # What is wrong from now on is of either kind, and came to this image's place by luck.
        gone = 0.5 * (before[0] * lost + before[1] * _CARRIED_OFF) * luck
        begun = 0.5 * _REGAINED * wrong * luck
        still = 1.0 - _REGAINED
        chances = np.array(
            [
                before[0] * (1.0 - lost) * right + begun,
                before[1] * (1.0 - _CARRIED_OFF) * turned + begun,
                gone + still * ((1.0 - _CHANGED) * before[2] + changed * before[3]) * luck,
                gone + still * ((1.0 - changed) * before[3] + _CHANGED * before[2]) * stays,
            ]
        )
        return np.asarray(chances / chances.sum())

    def array(self) -> Float64:
        """What a saved state keeps, (12,)."""
        return np.array([*self.position, *self.covariance.ravel(), *self.chances, self.place, self.way])

    @classmethod
    def of_array(cls, values: Float64) -> Self:
        """What `array` gave.

        Raises
        ------
        ValueError
            Of another shape.
        """
        if values.shape != (12,):
            raise ValueError(f"what places do has shape {values.shape}")
        return cls(values[:2].copy(), values[2:6].reshape(2, 2).copy(), values[6:10].copy(), int(values[10]), float(values[11]))


def missed(sd_heading: float, draws: int) -> float:
    """Chance that of so many headings drawn from a normal prediction none is near the true one, which it predicts, too.

    Parameters
    ----------
    sd_heading : float
        Of the prediction, radians.
    draws : int
    """
    return (1.0 - math.erf(math.radians(_TELLING_DEG) / (2.0 * max(sd_heading, 1e-9)))) ** draws


def support_of(votes: float, elsewhere: float, tolerance: float) -> float:
    """How many times as likely votes are if the best are at the headings that were looked at as if they are at others.

    Parameters
    ----------
    votes, elsewhere : float
        The best at these headings, and at those that are far from all of them.
    tolerance : float
        As in `VoteField`.
    """
    best = max(votes, elsewhere)
    ours, theirs = ((1.0 - _GROSS) * math.exp(-0.5 * ((best - some) / tolerance) ** 2) + _GROSS for some in (votes, elsewhere))
    return ours / theirs


def _share(place: int, places: Places, mean: Float64, covariance: Float64, nearest: Float64) -> float:
    """Probability of a place under a normal distribution over them all; of one far outside the map, most of it is nowhere.

    Parameters
    ----------
    place : int
    places : Places
    mean, covariance : float64 (2,) and (2, 2)
    nearest : float64 (2,)
        Position of the place that is nearest to the mean.
    """
    (xx, xy), (_, yy) = np.linalg.inv(covariance).tolist()

    def density(at: Float64, around: Float64) -> Float64:
        dx, dy = at[..., 0] - around[0], at[..., 1] - around[1]
        return np.asarray(np.exp(-0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy)))

    return float(density(places.positions[place], mean) / density(places.positions, nearest).sum())

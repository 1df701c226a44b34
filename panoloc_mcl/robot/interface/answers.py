"""What a localizer answers besides the `Estimate` of an image: the pose at any time, and where one image alone was taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Mount
from panoloc_mcl.robot.filters import Cluster, Status
from panoloc_mcl.robot.observation import VoteField
from panoloc_mcl.robot.observation.peaks import Guess

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TimedPose:
    """The pose at a time between or after images: the last answer, carried on by odometry.

    Parameters
    ----------
    timestamp : float
        Seconds.
    pose : float64 (3,)
        x, y, heading in the map frame, metres and radians.
    covariance : float64 (3, 3)
        That of the last answer, grown by the noise of the way since.
    status : Status
        Of the last answer; `STALE` if the pose was known then, but odometry alone no longer tells it well enough.
    answered : float
        Time stamp of the last answer, seconds.
    """

    timestamp: float
    pose: Float64
    covariance: Float64
    status: Status
    answered: float


@dataclass(frozen=True, eq=False)
class Location:
    """Where one image was taken, by itself: no odometry, no history.

    Parameters
    ----------
    pose : float64 (3,)
        x, y, heading in the map frame, metres and radians; the heading is NaN where the model gives none.
    covariance : float64 (3, 3)
        As if the pose were right; ``confidence`` says whether it is.
    confidence : float
        Probability that the pose is right; NaN where the map is not calibrated.
    problem : str
        Why the image cannot be used; empty if it can.
    map_revision : str
        Of the map that it was looked up in.
    vote_field : VoteField
        What the image says of every heading and place.
    map : str
        Name of that map.
    """

    pose: Float64
    covariance: Float64
    confidence: float
    problem: str
    map_revision: str
    vote_field: VoteField
    map: str = ""


def located(votes: VoteField, map_revision: str, mount: Mount, name: str = "") -> Location:
    """The base's pose that a vote field gives: the refined one if there is one, or else its best cell."""
    if votes.informative and votes.measurement is not None:
        pose, covariance = votes.measurement.pose, votes.measurement.covariance
    else:
        # Somewhere in the cell: uniform over a place's spacing and over a heading's step.
        peak, places = votes.peak, votes.places
        pose = np.array([*places.positions[peak.place], peak.heading])
        step = 2.0 * np.pi / max(len(votes.headings), 1)
        covariance = np.diag(np.array([places.spacing, places.spacing, step]) ** 2 / 12.0)
    of_base = Cluster(pose, covariance, 1.0).of_point(-mount.offset)
    return Location(of_base.pose, of_base.covariance, votes.confidence, votes.problem, map_revision, votes, name)


def tells_more(guess: Guess, best: Cluster, first: bool) -> bool:
    """Whether an image points elsewhere than the heaviest hypothesis, and more surely; of a first image all rests on it alone."""
    away = math.hypot(*(guess.pose - best.pose)[:2]) > 2.0 * best.spread_m
    return away and (first or guess.probability > best.mass)

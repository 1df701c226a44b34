"""What a localizer answers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.peaks import Guess
from panoloc_mcl.robot.reasons import Reason

Float64 = NDArray[np.float64]


class Status(StrEnum):
    """What the localizer thinks of itself.

    SEARCHING: the belief is spread out. CONVERGED: one compact cluster holds nearly all of it. AMBIGUOUS: two or more clusters hold
    much of it. LOST: it had converged, but the images no longer fit, the last one says that the robot is likely elsewhere, or it
    refutes the pose that the answer before was sure of. STALE: it was sure once, but no image has spoken for the pose for as long as
    odometry can be trusted, or odometry has led away from the pose of the last one that was taken in.
    """

    SEARCHING = "searching"
    CONVERGED = "converged"
    AMBIGUOUS = "ambiguous"
    LOST = "lost"
    STALE = "stale"


@dataclass(frozen=True, eq=False)
class Cluster:
    """One hypothesis about the pose.

    Parameters
    ----------
    pose : float64 (3,)
        Mean of its particles; the heading's is circular. Metres, radians.
    covariance : float64 (3, 3)
    mass : float
        Share of the whole weight.
    """

    pose: Float64
    covariance: Float64
    mass: float

    def of_point(self, offset: Float64) -> Cluster:
        """The same hypothesis about another point of the robot, at (x, y, 0) as seen from the one that the poses are of."""
        if not offset.any():
            return replace(self, pose=self.pose.copy(), covariance=self.covariance.copy())
        pose = compose(self.pose, offset)
        dx, dy = pose[:2] - self.pose[:2]
        # An error of the heading swings it round.
        swing = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        return replace(self, pose=pose, covariance=np.asarray(swing @ self.covariance @ swing.T))

    @property
    def spread_m(self) -> float:
        """Standard deviation of the position along its longest axis, metres: root of the larger eigenvalue."""
        (xx, xy), (_, yy) = self.covariance[:2, :2].tolist()
        return math.sqrt(max(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy), 0.0))

    @property
    def spread_deg(self) -> float:
        """Standard deviation of the heading, degrees."""
        return math.degrees(math.sqrt(max(float(self.covariance[2, 2]), 0.0)))


@dataclass(frozen=True, eq=False)
class FilterState:
    """The belief of a filter after an image.

    Parameters
    ----------
    clusters : tuple of Cluster
        By falling mass, at least one.
    status : Status
    match : float
        Share of the best cell's likelihood that the prediction explained: near 1 when the image came as expected, near 0 when the
        robot must be elsewhere. NaN when the image said nothing.
    best_place : int
        Place that the filter reports.
    best_place_votes : float
        Its votes at the reported heading; NaN when the image said nothing.
    particle_count, injected : int
        Particles, and how many of them were drawn from this image.
    effective_count : float
        N_eff before resampling.
    resampled : bool
    elsewhere : float
        Probability, the image seen, that the robot is not where odometry led: near 0 when the image came as expected. NaN where the
        filter does not know.
    backing : float
        How many times better the last image is explained by where odometry led than by anywhere on the map; votes of an image that is
        wrong about its pose do not count for it. NaN where the filter does not know.
    vouches : bool
        Whether the last image is sure enough of itself and says what is believed; true where images do not know how sure they are.
    """

    clusters: tuple[Cluster, ...]
    status: Status
    match: float
    best_place: int
    best_place_votes: float
    particle_count: int
    injected: int
    effective_count: float
    resampled: bool
    elsewhere: float = math.nan
    backing: float = math.nan
    vouches: bool = True

    def of_point(self, offset: Float64) -> FilterState:
        """The belief about another point of the robot (see `Cluster.of_point`), in arrays of its own."""
        return replace(self, clusters=tuple(cluster.of_point(offset) for cluster in self.clusters))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Answer to one image.

    Parameters
    ----------
    timestamp : float
        Of the belief: that of the newest image, seconds.
    pose : float64 (3,)
        (x, y, heading) in the map frame at that time, metres and radians: the mean of the heaviest cluster, never of two. While
        searching or ambiguous, ``best_guess`` instead, where it is more probable than that cluster.
    covariance : float64 (3, 3)
        Of the heaviest cluster.
    status : Status
    message : str
        What was wrong with this image or with odometry since the last one; empty when nothing was.
    reasons : tuple of Reason
        The same for programs.
    state : FilterState
        Clusters, particle count, N_eff and the other figures behind the status.
    vote_field : VoteField or None
        What the image said; None when its time stamp could not be used.
    stage_ms : dict
        Milliseconds of each stage, in order.
    best_guess : Guess or None
        What the image says by itself: the best cell's pose at the image's time, and its probability; None when it says nothing.
    map : str
        Name of the map that the pose is in.
    """

    timestamp: float
    pose: Float64
    covariance: Float64
    status: Status
    message: str
    state: FilterState
    vote_field: VoteField | None
    stage_ms: dict[str, float] = field(default_factory=dict)
    reasons: tuple[Reason, ...] = ()
    best_guess: Guess | None = None
    map: str = ""

    @property
    def clusters(self) -> tuple[Cluster, ...]:
        """All hypotheses, by falling mass."""
        return self.state.clusters

    @property
    def best_place(self) -> int:
        """Index of the reported place."""
        return self.state.best_place

    @property
    def best_place_votes(self) -> float:
        """Votes of the reported place; NaN when the image said nothing."""
        return self.state.best_place_votes

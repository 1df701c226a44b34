"""What a filter thinks of itself: a pure function of its hypotheses and of how well images fit them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from panoloc_mcl.robot.filters.estimate import Cluster, Status
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.settings.localizer import StatusSettings


def status_of(
    clusters: Sequence[Cluster],
    fit: float,
    elsewhere: float,
    expected: Sequence[float] | None,
    known: bool,
    vouched: bool,
    limits: StatusSettings,
) -> Status:
    """The status of a belief.

    Parameters
    ----------
    clusters : sequence of Cluster
        Hypotheses by falling mass, at least one.
    fit : float
        What the belief explains of the best votes, running average.
    elsewhere : float
        Probability, the last image seen, that the robot is not where odometry led.
    expected : (x, y, heading, spread_m, spread_deg) or None
        If the last answer was sure: where odometry led from its pose, and how surely. Metres, radians, degrees.
    known : bool
        Whether the pose was known before; who never knew it cannot be lost.
    vouched : bool
        As in `Memory`.
    limits : StatusSettings
    """
    best = clusters[0]
    unfit = fit < limits.lost_match or elsewhere > limits.lost_chance
    if known and (unfit or (expected is not None and _is_refuted(best, expected, limits))):
        return Status.LOST
    compact = best.spread_m < limits.converged_spread_m and best.spread_deg < limits.converged_spread_deg
    if best.mass > limits.converged_mass and compact and vouched:
        return Status.CONVERGED
    if sum(cluster.mass > limits.ambiguous_mass for cluster in clusters) >= 2:
        return Status.AMBIGUOUS
    return Status.SEARCHING


def vouches_for(best: Cluster, votes: VoteField, late: bool, limits: StatusSettings) -> bool:
    """Whether an image is sure enough of itself, and says what is believed: one that is sure of another pose stands behind nothing.

    Parameters
    ----------
    best : Cluster
    votes : VoteField
    late : bool
        The image is of an earlier time than the belief, so that their poses are not to be compared.
    limits : StatusSettings
    """
    if math.isnan(votes.confidence):
        return True
    guess = votes.guess
    if votes.confidence < limits.converged_confidence or guess is None or late:
        return votes.confidence >= limits.converged_confidence
    heading = float(guess.pose[2]) if votes.gives_heading else float(best.pose[2])
    said = (float(guess.pose[0]), float(guess.pose[1]), heading, best.spread_m, best.spread_deg)
    return not _is_refuted(best, said, limits)


def _is_refuted(best: Cluster, expected: Sequence[float], limits: StatusSettings) -> bool:
    """Whether the belief has left the pose that the last answer, or an image, was sure of: a robot that acted on it must be told."""
    x, y, heading, spread_m, spread_deg = expected
    off = math.degrees(abs(math.remainder(best.pose[2] - heading, 2.0 * math.pi)))
    way = math.hypot(best.pose[0] - x, best.pose[1] - y)
    return way > limits.converged_spread_m + 3.0 * spread_m or off > limits.converged_spread_deg + 3.0 * spread_deg

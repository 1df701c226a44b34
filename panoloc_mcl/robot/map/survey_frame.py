"""The frame of a survey whose errors add up.

Images tell how references lie to each other. Where all of them lie together, only given poses tell: where these err independently, by
their mean. A survey by dead reckoning errs otherwise: every turn and every step is a little wrong, and so is all that was surveyed
later. What it knows best is where it began, and a mean over all of it claims a frame far surer than it is. Which of the two a survey
is, its errors show: given poses minus mended ones, one after the other. The sizes of all kinds of errors are those that make them most
likely (restricted maximum likelihood, Patterson & Thompson 1971), and the frame is the generalised least squares estimate under them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.map.keyframes import ODOMETRY, Edges
from panoloc_mcl.robot.map.pose_graph import Priors, Solution, solve

Float64 = NDArray[np.float64]

# Fewer given poses do not tell a drift from chance; of more than the second number, some stand for all.
_FEWEST, _MOST = 12, 150
# A survey is said to drift where that makes its errors so many nats more likely: by chance, fewer than one in a thousand would be.
_CONVINCING = 8.0
# Where the search for the sizes of errors begins: independent ones in metres and radians, and turns and steps for the root of a metre.
_BEGIN = np.log([0.02, np.radians(0.5), np.radians(0.5), 0.01])
# Independent errors are not thought smaller than those of mended poses (see `mending`); others may be nothing.
_LEAST, _MOST_SD = np.log([0.003, np.radians(0.05), 1e-6, 1e-6]), float(np.log(10.0))
_ROUNDS, _SETTLED = 4, 0.1
# A given pose is far off alone if it errs so many times as far as usual, by edges of this weight at least.
_ALONE, _BORNE_OUT = 10.0, 0.5
# What holds a map whose survey tells ways alone: its first pose, metres and radians.
_HELD_M, _HELD_RAD = 1e-4, 1e-5


@dataclass(frozen=True, eq=False)
class SurveyFrame:
    """By how much a map that lies at the mean of a drifting survey is moved to where the survey began.

    Parameters
    ----------
    move : float64 (3,)
        Metres and radians: what is added to the position of the first given pose, and by how much everything is turned about it.
    about : float64 (2,)
        That position, as the map held it before.
    covariance : float64 (3, 3)
        Of ``move``.
    sizes : float64 (4,)
        Standard deviations of the survey's errors: independent ones of position and heading, metres and radians, and those that add up,
        turns and steps, for the root of a metre.
    """

    move: Float64
    about: Float64
    covariance: Float64
    sizes: Float64

    @classmethod
    def of_drift(cls, given: Float64, mended: Float64, told: NDArray[np.bool_]) -> Self | None:
        """The frame that a survey tells best; None where its errors do not add up.

        Parameters
        ----------
        given, mended : float64 (n, 3)
            Poses as surveyed, in the order in which they were, and as images have them relative to each other.
        told : bool (n,)
            Which were given at all, and are not far off alone.
        """
        chosen = np.flatnonzero(told)
        if len(chosen) < _FEWEST:
            return None
        # The first stays: it is where the survey began.
        chosen = chosen[:: -(-len(chosen) // _MOST)]
        given, poses = given[chosen], mended[chosen]
        about = poses[0, :2].copy()
        errors = _Errors(poses, _off(given, poses))
        independent, drifting = errors.sizes(drifts=False), errors.sizes(drifts=True)
        if errors.likelihood(drifting) < errors.likelihood(independent) + _CONVINCING:
            return None
        frame = cls(np.zeros(3), about, np.zeros((3, 3)), np.exp(drifting))
        for _ in range(_ROUNDS):
            # Turns are not small: effects are worked out anew where the frame has come to lie.
            moved = frame.moved(poses)
            step, covariance = _Errors(moved, _off(given, moved)).frame(drifting)
            frame = replace(frame, move=frame.move + step, covariance=covariance)
        return frame

    def moved(self, poses: Float64) -> Float64:
        """Poses (n, 3) in this frame."""
        there = np.array([*(self.about + self.move[:2]), self.move[2]])
        return compose(there, poses - np.array([*self.about, 0.0]))

    def turned(self, covariances: Float64) -> Float64:
        """Covariances (n, 3, 3) of poses, in this frame."""
        cos, sin = np.cos(self.move[2]), np.sin(self.move[2])
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(rotation @ covariances @ rotation.T)

    def errors_at(self, positions: Float64) -> Float64:
        """Covariances of poses at positions (n, 2) of this frame by what the frame errs, float64 (n, 3, 3)."""
        effects = _of_frame(positions - self.about - self.move[:2])
        return np.asarray(effects @ self.covariance @ np.swapaxes(effects, 1, 2))

    def as_odometry(self, given: Float64, told: NDArray[np.bool_]) -> Edges:
        """What such a survey tells: the way from each reference to the next one, given poses (n, 3) in the order of the survey."""
        chosen = np.flatnonzero(told)
        pairs = np.column_stack([chosen[:-1], chosen[1:]])
        ways = between(given[pairs[:, 0]], given[pairs[:, 1]])
        lengths = np.hypot(*ways[:, :2].T)
        single_m, single_rad, turn, walk = np.square(self.sizes)
        covariances = np.zeros((len(pairs), 3, 3))
        # A turn on the way shifts what is ahead to the side, by half of the way on the mean.
        covariances[:, 2, 2] = 2.0 * single_rad + turn * lengths
        for axis in range(2):
            covariances[:, axis, axis] = 2.0 * single_m + walk * lengths + covariances[:, 2, 2] * np.square(0.5 * lengths)
        return Edges.of(pairs, ways, covariances, ODOMETRY)

    @property
    def note(self) -> str:
        """What the user should know."""
        sds = np.sqrt(np.diag(self.covariance))
        return (
            "errors of the given poses add up from one reference to the next, as of dead reckoning: the map keeps to the first ones, "
            f"which tell where it lies to {100.0 * float(sds[:2].max()):.1f} cm and {np.degrees(sds[2]):.2f} degrees"
        )


def far_off_alone(given: Float64, poses: Float64, edges: Edges) -> NDArray[np.bool_]:
    """Given poses that err against those of their neighbours far more than is usual, bool (n,); a drift errs little there.

    Parameters
    ----------
    given, poses : float64 (n, 3)
        As surveyed, and as images have them.
    edges : Edges
        Who is whose neighbour; those that the others bear out count. Of a pose without any nobody knows, and it is believed.
    """
    edges = edges.chosen(edges.weights >= _BORNE_OUT)
    first, second = np.concatenate([edges.first, edges.second]), np.concatenate([edges.second, edges.first])
    miss = (between(given[first], given[second]) - between(poses[first], poses[second]))[:, :2]
    misses, off = np.hypot(*miss.T), np.full(len(given), np.nan)
    for index in np.unique(first):
        off[index] = np.median(misses[first == index])
    known = np.isfinite(off)
    return np.asarray(known & (off > _ALONE * np.median(off[known]))) if known.any() else known


def as_it_drifts(solution: Solution, given: Float64, told: NDArray[np.bool_]) -> tuple[Solution, SurveyFrame | None]:
    """Where errors of given poses add up, these tell the way from each reference to the next, and no longer where each is.

    As places they would bend the map: far parts of a survey that drifts contradict the images between them.

    Parameters
    ----------
    solution : Solution
        Of edges between images, and of given poses as places.
    given : float64 (n, 3)
    told : bool (n,)
        As `SurveyFrame.of_drift`.

    Returns
    -------
    solution : Solution
        The same where no errors add up. Otherwise it lies where the first given pose is.
    frame : SurveyFrame or None
    """
    frame = SurveyFrame.of_drift(given, solution.poses, told)
    if frame is None:
        return solution, None
    sds = np.full((len(given), 2), np.inf)
    sds[np.flatnonzero(told)[0]] = _HELD_M, _HELD_RAD
    held, images = Priors(given, sds, robust=False), np.arange(len(solution.edges))
    found: Solution = solution
    better: SurveyFrame | None = frame
    # How large its errors are shows once they no longer bend the map.
    for _ in range(_ROUNDS):
        found = solve(found.poses, solution.edges.joined(frame.as_odometry(given, told)), held)
        better = SurveyFrame.of_drift(given, found.poses, told)
        if better is None or np.abs(np.log(better.sizes / frame.sizes))[2:].max() < _SETTLED:
            break
        frame = better
    return replace(
        solution, poses=found.poses, covariances=found.covariances, edges=found.edges.chosen(images)
    ), better or frame


class _Errors:
    """Given poses minus mended ones, float64 (n, 3), and what makes them; sizes are logarithms of standard deviations (4,)."""

    def __init__(self, poses: Float64, off: Float64) -> None:
        count, positions = len(poses), poses[:, :2]
        self.off = off.ravel()
        steps = np.hypot(*np.diff(positions, axis=0).T)
        # A turn on the way to the next reference shifts all later ones to the side, a wrong step shifts them along.
        later = np.arange(count)[:, None] > np.arange(count - 1)
        lever = positions[:, None] - 0.5 * (positions[:-1] + positions[1:])
        turns = np.stack([-lever[..., 1], lever[..., 0], np.ones(later.shape)], axis=1) * (later * np.sqrt(steps))[:, None]
        walks = later @ (later * steps).T
        single = np.eye(count)
        self._kinds = (
            np.kron(single, np.diag([1.0, 1.0, 0.0])),
            np.kron(single, np.diag([0.0, 0.0, 1.0])),
            (turns.reshape(3 * count, -1)) @ turns.reshape(3 * count, -1).T,
            np.kron(walks, np.diag([1.0, 1.0, 0.0])),
        )
        ahead = positions - positions[0]
        # What errors do not tell from: where the frame lies, and a metre that is not quite one.
        longer = np.column_stack([ahead, np.zeros(count)]).reshape(3 * count, 1)
        self._free = np.hstack([_of_frame(ahead).reshape(3 * count, 3), longer])

    def sizes(self, drifts: bool) -> Float64:
        """The most likely ones, with or without errors that add up."""
        # Here, since a robot that runs does not need it.
        from scipy.optimize import minimize

        unknown = 4 if drifts else 2

        def unlikelihood(some: Float64) -> float:
            return -self.likelihood(np.concatenate([some, _LEAST[unknown:]]))

        bounds = [(float(least), _MOST_SD) for least in _LEAST[:unknown]]
        found = minimize(unlikelihood, _BEGIN[:unknown], method="L-BFGS-B", bounds=bounds).x
        return np.concatenate([found, _LEAST[unknown:]])

    def likelihood(self, sizes: Float64) -> float:
        """Restricted log likelihood, up to a constant."""
        factor, normal, best = self._solved(sizes)
        left = self.off - self._free @ best
        determinants = 2.0 * np.log(np.diag(factor)).sum() + np.linalg.slogdet(normal)[1]
        return -0.5 * float(determinants + left @ cho_solve((factor, True), left))

    def frame(self, sizes: Float64) -> tuple[Float64, Float64]:
        """Where the frame lies, (3,), and its covariance."""
        _, normal, best = self._solved(sizes)
        return best[:3], np.asarray(np.linalg.inv(normal)[:3, :3])

    def _solved(self, sizes: Float64) -> tuple[Float64, Float64, Float64]:
        covariance = sum(np.exp(2.0 * size) * kind for size, kind in zip(sizes, self._kinds, strict=True))
        factor = np.linalg.cholesky(covariance)
        weighed = cho_solve((factor, True), self._free)
        normal = self._free.T @ weighed
        return factor, normal, np.linalg.solve(normal, weighed.T @ self.off)


def _off(given: Float64, poses: Float64) -> Float64:
    off = given - poses
    off[:, 2] = wrap_angle(off[:, 2])
    return off


def _of_frame(ahead: Float64) -> Float64:
    """What a unit of each of a frame's moves does to poses that lie ahead (n, 2) of its centre, float64 (n, 3, 3)."""
    effects = np.broadcast_to(np.eye(3), (len(ahead), 3, 3)).copy()
    effects[:, 0, 2], effects[:, 1, 2] = -ahead[:, 1], ahead[:, 0]
    return effects

"""The frame of a survey whose errors add up.

Images tell how references lie to each other. Where all of them lie together, only given poses tell: where these err independently, by
their mean. A survey by dead reckoning errs otherwise: every turn and every step is a little wrong, and so is all that was surveyed
later. What it knows best is where it began, and a mean over all of it claims a frame far surer than it is. Which of the two a survey
is, its errors show: given poses minus mended ones, one after the other. The sizes of all kinds of errors are those that make them most
likely (restricted maximum likelihood, Patterson & Thompson 1971), and the frame is the generalised least squares estimate under them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from panoloc_mcl.robot.geometry import compose, wrap_angle

Float64 = NDArray[np.float64]

# Fewer given poses do not tell a drift from chance; of more than the second number, some stand for all.
_FEWEST, _MOST = 12, 150
# A survey is said to drift where that makes its errors so many nats more likely: by chance, fewer than one in a thousand would be.
_CONVINCING = 8.0
# Where the search for the sizes of errors begins: independent ones in metres and radians, and turns and steps for the root of a metre.
_BEGIN = np.log([0.02, np.radians(0.5), np.radians(0.5), 0.01])
# Independent errors are not thought smaller than those of mended poses (see `mending`); others may be nothing.
_LEAST, _MOST_SD = np.log([0.003, np.radians(0.05), 1e-6, 1e-6]), float(np.log(10.0))
_ROUNDS = 4


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
    """

    move: Float64
    about: Float64
    covariance: Float64

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
        frame = cls(np.zeros(3), about, np.zeros((3, 3)))
        errors = _Errors(poses, _off(given, poses))
        independent, drifting = errors.sizes(drifts=False), errors.sizes(drifts=True)
        if errors.likelihood(drifting) < errors.likelihood(independent) + _CONVINCING:
            return None
        for _ in range(_ROUNDS):
            # Turns are not small: effects are worked out anew where the frame has come to lie.
            moved = frame.moved(poses)
            step, covariance = _Errors(moved, _off(given, moved)).frame(drifting)
            frame = cls(frame.move + step, about, covariance)
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

    @property
    def note(self) -> str:
        """What the user should know."""
        sds = np.sqrt(np.diag(self.covariance))
        return (
            "errors of the given poses add up from one reference to the next, as of dead reckoning: the map keeps to the first ones, "
            f"which tell where it lies to {100.0 * float(sds[:2].max()):.1f} cm and {np.degrees(sds[2]):.2f} degrees"
        )


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

"""Errors of surveys, as a map is to mend them: small ones everywhere, a drift along the recording, and a few gross ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray, wrap_angle

# What single rows are off by when they are grossly wrong, and the share of all rows that are.
_GROSS_M, _GROSS_SHARE = 1.0, 0.05
_DRIFT = 0.02

Disturbed = tuple[FloatArray, list[int]]


def _noise(sd_m: float, sd_deg: float) -> Callable[[FloatArray, np.random.Generator], Disturbed]:
    def disturb(poses: FloatArray, rng: np.random.Generator) -> Disturbed:
        return poses + rng.standard_normal(poses.shape) * (sd_m, sd_m, np.radians(sd_deg)), []

    return disturb


def _drift(poses: FloatArray, rng: np.random.Generator) -> Disturbed:
    """Row by row, to and fro: positions wander off to one side, drawn at random, by a share of the way."""
    rows: list[int] = []
    for number, y in enumerate(np.unique(poses[:, 1].round(3))):
        row = np.flatnonzero(np.abs(poses[:, 1] - y) < 1e-3)
        row = row[np.argsort(poses[row, 0])]
        rows += row[:: 1 if number % 2 == 0 else -1].tolist()
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[rows, :2], axis=0).T))])
    side, moved = rng.uniform(-np.pi, np.pi), poses.copy()
    moved[rows, :2] += _DRIFT * way[:, None] * [np.cos(side), np.sin(side)]
    return moved, []


def _gross(poses: FloatArray, rng: np.random.Generator) -> Disturbed:
    """One row in twenty: two swapped, others a metre off or turned, in turn."""
    count = max(2, round(_GROSS_SHARE * len(poses)))
    # Two rows that are swapped count as one mistake, but both are wrong.
    wrong = rng.permutation(len(poses))[: max(count, 4)].tolist()
    moved = poses.copy()
    moved[wrong[:2]] = moved[wrong[1::-1]]
    for number, index in enumerate(wrong[2:]):
        if number % 2:
            moved[index, 2] += rng.uniform(0.5, 2.0 * np.pi - 0.5)
        else:
            angle = rng.uniform(-np.pi, np.pi)
            moved[index, :2] += _GROSS_M * np.array([np.cos(angle), np.sin(angle)])
    return moved, sorted(wrong)


#: By name: what becomes of poses (n, 3), and which of them are grossly wrong.
SURVEYS: dict[str, tuple[str, Callable[[FloatArray, np.random.Generator], Disturbed]]] = {
    "exact": ("exact poses", lambda poses, rng: (poses.copy(), [])),
    "2cm": ("off by 2 cm and 1 degree", _noise(0.02, 1.0)),
    "10cm": ("off by 10 cm and 3 degrees", _noise(0.10, 3.0)),
    "drift": ("a drift of 2 % of the way", _drift),
    "gross": ("one in twenty grossly wrong: two swapped, one 1 m off, one turned", _gross),
}


def disturbed(kind: str, poses: FloatArray, seed: int) -> Disturbed:
    """Poses with the errors of a survey, and the indices of those that are grossly wrong.

    Parameters
    ----------
    kind : str
        A name in `SURVEYS`.
    poses : float64 (n, 3)
    seed : int
    """
    moved, wrong = SURVEYS[kind][1](poses, np.random.default_rng(seed))
    moved[:, 2] = wrap_angle(moved[:, 2])
    return moved, wrong

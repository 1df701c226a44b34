"""What stands beside the paper's numbers, and how much of it is run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M
from panoloc_mcl.tools.evaluation.record import group_of
from panoloc_mcl.tools.evaluation.tables import PAPER_TABLE_2

PAPER, KALMAN, MONTE_CARLO = "paper, Kalman", "default, Kalman", "default, Monte Carlo, nothing known"
_TRACKER = {"localizer.mode": "kalman_orientation", "localizer.initial": "known_heading"}
#: What each method changes of the defaults, as the shipped configurations paper, kalman and global do.
METHODS: dict[str, dict[str, Any]] = {
    PAPER: {
        **_TRACKER,
        "localizer.kalman_orientation.headings": 5,
        "observation.model": "paper",
        "observation.paper.components": 15,
        "observation.paper.hypotheses": 50,
        "observation.paper.pixels": 1000,
        "observation.paper.vote_width": 0.3,
    },
    KALMAN: _TRACKER,
    MONTE_CARLO: {"localizer.mode": "monte_carlo", "localizer.initial": "uniform"},
}
MORE_PIXELS = {
    "paper, Kalman, 3000 pixels": {**METHODS[PAPER], "observation.paper.pixels": 3000, "observation.paper.trim_to": 2400}
}
LIGHTS = tuple(PAPER_TABLE_2)
NOISE = (0.1, 0.25, 0.4, 0.5, 0.6, 0.75)
BARS = (0.1, 0.3, 0.5, 0.7, 0.8, 0.9)
RUNS, PASSES, FIGURE_PASSES = 50, 1000, 225


@dataclass(frozen=True)
class Effort:
    """How much is run.

    Parameters
    ----------
    seeds, figure_seeds : int
        Seeds of Table 2 and of figures 6 and 8.
    noise, bars : tuple of float
    frames : int or None
        Of each sequence.
    sequences : str or list of str
    images : int
        Of figure 4's curve over many images.
    timed : int
        Rounds of the measurement of speed.
    """

    seeds: int
    figure_seeds: int
    noise: tuple[float, ...] = NOISE
    bars: tuple[float, ...] = BARS
    frames: int | None = None
    sequences: str | list[str] = "all"
    images: int = 60
    timed: int = 15


def effort_for(dataset: Dataset, seeds: int | None = None, figure_seeds: int | None = None, *, quick: bool = False) -> Effort:
    """As many seeds as the numbers of runs and passes ask for, where none are given; ``quick``: a few images, which prove nothing."""
    if quick:
        return Effort(seeds or 1, figure_seeds or 1, (0.5,), (0.7,), 6, ["*_00"], 3, 2)
    runs, passes = [], []
    for light in LIGHTS:
        drives = [
            drive for name, drive in dataset.sequences.items() if group_of(name) == light and drive.groundtruth is not None
        ]
        if drives:
            runs.append(len(drives))
            passes.append(
                sum(passed(drive.groundtruth.at(drive.times), dataset) for drive in drives if drive.groundtruth is not None)
            )
    # A few passes are over before the robot has converged.
    least = max(0.95 * min(passes, default=1), 1.0)
    enough = max(-(-RUNS // min(runs, default=1)), int(np.ceil(PASSES / least)))
    of_figures = int(np.ceil(FIGURE_PASSES / max(0.95 * (passes or [1])[0], 1.0)))
    return Effort(seeds or min(enough, 1000), figure_seeds or min(of_figures, 100))


def passed(poses: FloatArray, dataset: Dataset) -> int:
    """Images of poses (n, 3) that pass a place."""
    apart = np.hypot(*(poses[:, None, :2] - dataset.references.poses[None, :, :2]).transpose(2, 0, 1))
    return int(np.sum(apart.min(axis=1) <= PASS_RADIUS_M))


def recipes(kind: str, shares: Sequence[float]) -> list[str]:
    """The corruptions of a figure, from none on."""
    return ["clean", *(f"{kind}:{share:g}" for share in shares)]

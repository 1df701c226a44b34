"""What happens to a robot in the study of the filter: its images, its odometry, and when they arrive."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.studies.filtering.kidnaps import kidnapped
from panoloc_mcl.robot.errors import ConfigError, did_you_mean
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import Trajectory
from panoloc_mcl.tools.runs.pipeline import Task

KIDNAP_EVERY = 12
LATE_S = 0.5
# Of the recorded odometry of the simulator, and how much larger the condition makes it.
WAY_NOISE, TURN_NOISE, DRIFT_DEG_M, TIMES = 0.10, 0.08, 1.0, 3.0
_WRONG_STARTS_DEG = (30, 90, 180)


@dataclass(frozen=True)
class Condition:
    """One way to disturb a drive, and the settings of the run.

    Parameters
    ----------
    says : str
        For the help and the report.
    kidnapped : bool
        Carried away again and again: see `kidnaps`.
    foreign_every : int
        Every so many images are of another data set; 0 = none.
    dropped : float
        Share of the images that never come.
    odometry_noise : float
        How many times the recorded noise.
    late_s : float
        How long after it was taken an image arrives; every second one only after its successor.
    image_only : bool
        Odometry is withheld.
    settings : mapping
        Of the run's configuration.
    """

    says: str
    kidnapped: bool = False
    foreign_every: int = 0
    dropped: float = 0.0
    odometry_noise: float = 1.0
    late_s: float = 0.0
    image_only: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)


def _started(mode: str, error_deg: float) -> Condition:
    says = f"{mode}, start heading known" if error_deg == 0 else f"{mode}, start heading wrong by {error_deg} degrees"
    return Condition(
        says, settings={"localizer": {"mode": mode, "initial": "known_heading", "initial_heading_error_deg": error_deg}}
    )


CONDITIONS = {
    "plain": Condition("position and heading unknown"),
    "kidnap": Condition(
        f"every {KIDNAP_EVERY} images carried to where a uniformly drawn image was taken, turned by a uniformly drawn angle, "
        "odometry silent there",
        kidnapped=True,
    ),
    "foreign": Condition("every third image is one of another data set", foreign_every=3),
    "drop": Condition("30 % of the images, at random, never come", dropped=0.3),
    "noisy_odometry": Condition(
        f"noise of odometry {TIMES:g} times that recorded, of which each increment has {100 * WAY_NOISE:g} % of its way and "
        f"{100 * TURN_NOISE:g} % of its turn, and a drift of {DRIFT_DEG_M:g} degree a metre",
        odometry_noise=TIMES,
    ),
    "late": Condition(
        f"images arrive {LATE_S:g} s after they were taken, every second one only after its successor", late_s=LATE_S
    ),
    "image_only": Condition("odometry is withheld", image_only=True),
    "no_virtual_places": Condition(
        "a map of the references alone", settings={"observation": {"votes": {"virtual_places": {"enabled": False}}}}
    ),
    "kalman": _started("kalman_orientation", 0),
    **{f"kalman_{degrees}": _started("kalman_orientation", degrees) for degrees in _WRONG_STARTS_DEG},
    **{f"monte_carlo_{degrees}": _started("monte_carlo", degrees) for degrees in (0, *_WRONG_STARTS_DEG)},
}


def chosen(names: Sequence[str], foreign: bool) -> tuple[str, ...]:
    """The conditions that are asked for, none twice; ``all`` takes them all.

    Raises
    ------
    ConfigError
        One that there is not, or that needs another data set where none is named.
    """
    if "all" in names:
        names = tuple(CONDITIONS)
    for name in names:
        if name not in CONDITIONS:
            remedy = did_you_mean(name, CONDITIONS) or f"use all, or of {', '.join(CONDITIONS)}"
            raise ConfigError(f"--conditions {name}: no such condition; {remedy}")
        if CONDITIONS[name].foreign_every and not foreign:
            raise ConfigError(f"--conditions {name}: needs another data set's images; give --foreign DATASET")
    return tuple(dict.fromkeys(names))


def trips(drives: list[Drive], condition: Condition, seed: int, columns: int) -> list[tuple[Task, NDArray[np.int64] | None]]:
    """The drives of one group as they are run: as recorded, or carried away; then also the columns that each panorama is turned by."""
    if not condition.kidnapped:
        return [(Task(drive, np.zeros(len(drive), dtype=np.bool_)), None) for drive in drives]
    carried = kidnapped(drives, KIDNAP_EVERY, columns, np.random.default_rng((seed, zlib.crc32(b"kidnap"))))
    return [(Task(carried.drive, carried.carried), carried.turns)]


def disturbed(
    drive: Drive, condition: Condition, seed: int, foreign: Sequence[ImageSource]
) -> tuple[Drive, NDArray[np.float64], NDArray[np.bool_]]:
    """A drive under a condition.

    Returns
    -------
    drive : Sequence
        With other images and odometry.
    arrival : float64 (n,)
        When each image arrives, seconds.
    kept : bool (n,)
        Which images arrive at all.
    """
    rng = np.random.default_rng((seed, zlib.crc32(drive.name.encode()), 1))
    files = list(drive.files)
    if condition.foreign_every:
        for number, index in enumerate(range(condition.foreign_every - 1, len(files), condition.foreign_every)):
            files[index] = foreign[(number + seed * len(files)) % len(foreign)]
    odometry = None if condition.image_only else drive.odometry
    if odometry is not None and condition.odometry_noise > 1.0:
        odometry = noisier(odometry, condition.odometry_noise, rng)
    kept = rng.random(len(drive)) >= condition.dropped
    arrival = drive.times.copy()
    if condition.late_s > 0.0:
        arrival += condition.late_s
        swapped = np.arange(0, len(drive) - 1, 2)
        arrival[swapped] = arrival[swapped + 1] + 1e-6
    return replace(drive, files=tuple(files), odometry=odometry), arrival, kept


def noisier(odometry: Trajectory, times: float, rng: np.random.Generator) -> Trajectory:
    """Odometry whose noise is so many times as large, if it was what the constants above say."""
    steps = between(odometry.poses[:-1], odometry.poses[1:])
    way, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    # Independent errors add by their squares, a drift adds up.
    more = np.sqrt(times**2 - 1.0)
    steps[:, :2] *= 1.0 + more * WAY_NOISE * rng.standard_normal((len(steps), 1))
    steps[:, 2] += more * TURN_NOISE * turn * rng.standard_normal(len(steps))
    steps[:, 2] += (times - 1.0) * np.radians(DRIFT_DEG_M) * way * rng.choice([-1.0, 1.0])
    poses = [odometry.poses[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return Trajectory(odometry.times, np.array(poses))

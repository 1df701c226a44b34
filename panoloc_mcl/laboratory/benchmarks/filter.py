"""The particle filter alone, against vectorised NumPy and two packages: full cycles, in turns in one run.

A cycle is predict (a drive with noise), weight (an interpolated look-up in a vote field), resample and estimate. All get the same
field and the same motion, and resample every time. What this package's filter does beyond that (clusters and status, and in one row
recovery) is in its time; the others give mean and covariance.

The packages come with ``pip install "panoloc-mcl[benchmark]"``; those that are missing are left out. (`particles` 0.4 asks for NumPy
below 2, but does what is asked of it here with NumPy 2, too: install it with ``--no-deps``.)
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Number, Ratio, Report
from panoloc_mcl.laboratory.timing import in_a_process, interleaved, memory_mb
from panoloc_mcl.robot.filters import MonteCarloFilter, Start
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation import Places, VoteField
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings, RecoverySettings, ResamplingSettings, StatusSettings

Array = NDArray[Any]

POSITION, HEADING = (2.5, 3.0), 0.5
START = Start(POSITION, HEADING, 0.1, 0.1)
SD_TURN, SD_WAY = 0.02, 0.03
WAY, TURN = 0.1, 0.1
_OF_MEMORY = 1_000_000


def filter_cycle(counts: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 30) -> Report:
    """Time of a cycle a particle at each count, and how many times faster than NumPy's that is; memory of a particle."""
    field = a_field()
    memory = in_a_process(f"{__name__}:memory_of", str(_OF_MEMORY))["bytes"]
    report = Report(
        f"The particle filter: a full cycle. At the peak of a cycle with {_OF_MEMORY} particles it takes {memory:.1f} bytes a particle."
    )
    clocks = ("clock: ns a particle", "processor: ns a particle", "faster than NumPy, clock (95 %)", "processor (95 %)")
    table = report.table("", ("particles", "what", *clocks), "Rounds in turns; one thread unless said.")
    for count in counts:
        tasks = {
            "this filter": ours(field, count, recovery=False),
            "this filter with recovery": ours(field, count),
            "this filter with recovery, 2 threads": ours(field, count, threads=2),
            "NumPy, float64": numpy_cycle(field, count),
        }
        for name, make in (("particles", particles_cycle), ("filterpy", filterpy_cycle)):
            try:
                tasks[f"package {name}"] = make(field, count)
            except ImportError:
                print(f"note: package {name} is not installed", file=sys.stderr)
        spent = interleaved(tasks, max(5, min(repeats, 3_000_000 // count)), warm_up=2)
        base = spent["NumPy, float64"]
        for name, times in spent.items():
            each = (Number(1e9 / count * float(np.median(seconds)), 1) for seconds in times)
            table.add(count, name, *each, Ratio.of(base.clock, times.clock), Ratio.of(base.processor, times.processor))
    return report


def memory_of(count: str) -> dict[str, float]:
    """Bytes a particle at the peak of some cycles, measured in this process: to be called in a fresh one."""
    field = a_field()
    ours(field, 20_000)()
    before = memory_mb(peak=False)
    cycle = ours(field, int(count))
    for _ in range(4):
        cycle()
    return {"bytes": 1024**2 * (memory_mb() - before) / int(count)}


def a_field() -> VoteField:
    """Votes at 360 headings and 525 places 0.25 m apart, as a map of the hall has them; one hill at the start."""
    places = Places(np.array([(0.25 * x, 0.25 * y) for y in range(25) for x in range(21)]))
    headings = 2.0 * np.pi * np.arange(360) / 360
    far = np.hypot(*(places.positions - POSITION).T) / 0.4
    off = angle_difference(headings, HEADING) / np.radians(6.0)
    votes = (0.9 * np.exp(-0.5 * (far[None, :] ** 2 + off[:, None] ** 2))).astype(np.float32)
    return VoteField(votes, headings, places, 0.15 * 0.9)


def steps() -> tuple[Motion, Motion]:
    """To and fro, so that the field stays true."""
    noise = {"sd_first_turn": SD_TURN, "sd_along": SD_WAY, "sd_last_turn": SD_TURN, "distance": WAY, "turn": TURN}
    there = Motion(np.array([WAY, 0.0, TURN]), along=WAY, last_turn=TURN, **noise)
    return there, there.reversed()


def ours(field: VoteField, count: int, threads: int = 1, recovery: bool = True) -> Callable[[], object]:
    """One cycle of this package's filter; without recovery it does no more than the others do."""
    settings = MonteCarloSettings(
        particles=count,
        threads=threads,
        resampling=ResamplingSettings(below=1.0),
        recovery=RecoverySettings() if recovery else RecoverySettings(min_share=0.0, max_share=0.0),
    )
    belief = MonteCarloFilter(field.places, START, settings, StatusSettings(), np.random.default_rng(0))
    ways, state = steps(), {"count": 0}

    def cycle() -> object:
        state["count"] += 1
        belief.propagate(ways[state["count"] % 2])
        belief.update(field)
        return belief.state()

    return cycle


class Plain:
    """The same cycle in float64 NumPy, without a loop; poses are columns of (n, 3)."""

    def __init__(self, field: VoteField, seed: int = 0) -> None:
        self.field, self.raster, self.rng = field, field.places.raster, np.random.default_rng(seed)
        self.votes = field.votes.astype(np.float64)
        self.count = 0

    def start(self, count: int) -> Array:
        """Poses (count, 3) around the start."""
        return np.array([*POSITION, HEADING]) + 0.1 * self.rng.standard_normal((count, 3))

    def predict(self, poses: Array) -> Array:
        """Turn, drive, turn, with noise."""
        self.count += 1
        motion, normals = steps()[self.count % 2], self.rng.standard_normal((3, len(poses)))
        direction = poses[:, 2] + motion.first_turn + motion.sd_first_turn * normals[0]
        way = motion.along + motion.sd_along * normals[1]
        heading = direction + motion.last_turn + motion.sd_last_turn * normals[2]
        moved = [poses[:, 0] + way * np.cos(direction), poses[:, 1] + way * np.sin(direction)]
        return np.stack([*moved, np.mod(heading + np.pi, 2.0 * np.pi) - np.pi], axis=1)

    def log_likelihood(self, poses: Array) -> Array:
        """Of the votes read at the poses."""
        raster, (count, _) = self.raster, self.votes.shape
        column = np.floor((poses[:, 0] - raster.origin[0]) / raster.cell).astype(np.int64)
        row = np.floor((poses[:, 1] - raster.origin[1]) / raster.cell).astype(np.int64)
        inside = (column >= 0) & (row >= 0) & (column < raster.shape[1]) & (row < raster.shape[0])
        cell = np.where(inside, row * raster.shape[1] + column, 0)
        position = poses[:, 2] * (count / (2.0 * np.pi))
        lower = np.floor(position)
        fraction = (position - lower)[:, None]
        first = lower.astype(np.int64) % count
        places = raster.neighbours[cell]
        here = self.votes[first[:, None], places] * (1.0 - fraction)
        here += self.votes[((first + 1) % count)[:, None], places] * fraction
        read = np.where(inside, np.sum(here * raster.weights[cell], axis=1), 0.0)
        shortfall = np.maximum(self.field.peak.votes - read, 0.0) / self.field.tolerance
        return np.log(0.995 * np.exp(-0.5 * shortfall**2) + 0.005)

    @staticmethod
    def estimate(poses: Array, weights: Array) -> tuple[Array, Array]:
        """Mean and covariance, the heading on the circle."""
        sine, cosine = weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])
        mean = np.array([weights @ poses[:, 0], weights @ poses[:, 1], np.arctan2(sine, cosine)])
        off = poses - mean
        off[:, 2] = np.mod(off[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        return mean, (off * weights[:, None]).T @ off


def numpy_cycle(field: VoteField, count: int, resample: Callable[[Array], Array] | None = None) -> Callable[[], object]:
    """One cycle of `Plain`, with systematic resampling by a search in the cumulative sum unless another is given."""
    plain = Plain(field)
    state = {"poses": plain.start(count)}

    def search(weights: Array) -> Array:
        targets = (np.arange(count) + plain.rng.random()) / count
        return np.minimum(np.searchsorted(np.cumsum(weights), targets, side="right"), count - 1)

    def cycle() -> object:
        poses = plain.predict(state["poses"])
        logs = plain.log_likelihood(poses)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        answer = plain.estimate(poses, weights)
        state["poses"] = poses[(resample or search)(weights)]
        return answer

    return cycle


def particles_cycle(field: VoteField, count: int) -> Callable[[], object]:
    """One cycle of the package `particles` (Chopin), whose model is written with the functions of `Plain`."""
    import particles

    plain = Plain(field)

    class Drive(particles.FeynmanKac):  # type: ignore[misc]
        def M0(self, N: int) -> Array:  # noqa: N802
            return plain.start(N)

        def M(self, t: int, xp: Array) -> Array:  # noqa: N802
            return plain.predict(xp)

        def logG(self, t: int, xp: Array, x: Array) -> Array:  # noqa: N802
            return plain.log_likelihood(x)

    # ESSrmin: always resample, as the others do.
    filtering = particles.SMC(fk=Drive(T=10**9), N=count, resampling="systematic", ESSrmin=1.0)

    def cycle() -> object:
        next(filtering)
        return plain.estimate(filtering.X, filtering.W)

    return cycle


def filterpy_cycle(field: VoteField, count: int) -> Callable[[], object]:
    """One cycle with the resampling of the package `filterpy` (Labbe), which leaves the rest to NumPy."""
    from filterpy.monte_carlo import systematic_resample

    return numpy_cycle(field, count, systematic_resample)

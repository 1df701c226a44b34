"""The particle filter alone, against vectorised NumPy and two packages: full cycles, interleaved in one run. Prints Markdown.

    python scripts/benchmark_filter.py [--particles 10000 100000 1000000] [--repeats N]

A cycle is predict (a drive with noise), weight (an interpolated look-up in a vote field), resample and estimate. All get the same
field and the same motion, and resample every time. What this package's filter does beyond that (clusters and status, and in one row
recovery) is in its time; the others give mean and covariance.

The packages come with ``pip install "panoloc-mcl[benchmark]"``; those that are missing are left out. (`particles` 0.4 asks for NumPy
below 2, but does what is asked of it here with NumPy 2, too: install it with ``--no-deps``.)
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

# Before NumPy is loaded, which reads them once.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np  # noqa: E402

from panoloc_mcl.robot.filters import MonteCarloFilter, Start  # noqa: E402
from panoloc_mcl.robot.geometry import angle_difference  # noqa: E402
from panoloc_mcl.robot.motion import Motion  # noqa: E402
from panoloc_mcl.robot.observation import Places, VoteField  # noqa: E402
from panoloc_mcl.robot.settings.localizer import (  # noqa: E402
    MonteCarloSettings,
    RecoverySettings,
    ResamplingSettings,
    StatusSettings,
)

START = Start((2.5, 3.0), 0.5, 0.1, 0.1)
SD_TURN, SD_WAY = 0.02, 0.03
WAY, TURN = 0.1, 0.1


def a_field() -> VoteField:
    """Votes at 360 headings and 525 places 0.25 m apart, as a map of the hall has them; one hill at the start."""
    places = Places(np.array([(0.25 * x, 0.25 * y) for y in range(25) for x in range(21)]))
    headings = 2.0 * np.pi * np.arange(360) / 360
    far = np.hypot(*(places.positions - START.position).T) / 0.4
    off = angle_difference(headings, START.heading) / np.radians(6.0)
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

    def start(self, count: int) -> np.ndarray:
        """Poses (count, 3) around the start."""
        return np.array([*START.position, START.heading]) + 0.1 * self.rng.standard_normal((count, 3))

    def predict(self, poses: np.ndarray) -> np.ndarray:
        """Turn, drive, turn, with noise."""
        self.count += 1
        motion, normals = steps()[self.count % 2], self.rng.standard_normal((3, len(poses)))
        direction = poses[:, 2] + motion.first_turn + motion.sd_first_turn * normals[0]
        way = motion.along + motion.sd_along * normals[1]
        heading = direction + motion.last_turn + motion.sd_last_turn * normals[2]
        moved = [poses[:, 0] + way * np.cos(direction), poses[:, 1] + way * np.sin(direction)]
        return np.stack([*moved, np.mod(heading + np.pi, 2.0 * np.pi) - np.pi], axis=1)

    def log_likelihood(self, poses: np.ndarray) -> np.ndarray:
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
    def estimate(poses: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance, the heading on the circle."""
        sine, cosine = weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])
        mean = np.array([weights @ poses[:, 0], weights @ poses[:, 1], np.arctan2(sine, cosine)])
        off = poses - mean
        off[:, 2] = np.mod(off[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        return mean, (off * weights[:, None]).T @ off


def numpy_cycle(
    field: VoteField, count: int, resample: Callable[[np.ndarray], np.ndarray] | None = None
) -> Callable[[], object]:
    """One cycle of `Plain`, with systematic resampling by a search in the cumulative sum unless another is given."""
    plain = Plain(field)
    state = {"poses": plain.start(count)}

    def search(weights: np.ndarray) -> np.ndarray:
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

    class Drive(particles.FeynmanKac):
        def M0(self, N: int) -> np.ndarray:  # noqa: N802
            return plain.start(N)

        def M(self, t: int, xp: np.ndarray) -> np.ndarray:  # noqa: N802
            return plain.predict(xp)

        def logG(self, t: int, xp: np.ndarray, x: np.ndarray) -> np.ndarray:  # noqa: N802
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


@dataclass(frozen=True)
class Times:
    """Seconds of a cycle by the clock, and of the processor."""

    clock: float
    processor: float


def interleaved(tasks: dict[str, Callable[[], object]], repeats: int) -> dict[str, list[Times]]:
    """Times of each task, all run in turn, so that a busy moment of the machine strikes all alike."""
    for task in tasks.values():
        task()
        task()
    spent: dict[str, list[Times]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, task in tasks.items():
            clock, processor = time.perf_counter(), time.process_time()
            task()
            spent[name].append(Times(time.perf_counter() - clock, time.process_time() - processor))
    return spent


def filter_speed(counts: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 30) -> None:
    """Print the time of a cycle a particle, and how many times faster than NumPy's that is, at each count."""
    field = a_field()
    print("\n## The particle filter: a full cycle\n")
    print("Nanoseconds a particle; ratios are medians over pairs from the same round.\n")
    print("| particles | what | clock, median | processor, median | faster than NumPy, clock | processor |")
    print("|---|---|---|---|---|---|")
    for count in counts:
        tasks = {
            "this filter": ours(field, count, recovery=False),
            "this filter with recovery": ours(field, count),
            "this filter with recovery, 2 threads": ours(field, count, threads=2),
        }
        tasks["NumPy, float64"] = numpy_cycle(field, count)
        for name, make in (("particles", particles_cycle), ("filterpy", filterpy_cycle)):
            try:
                tasks[f"package {name}"] = make(field, count)
            except ImportError:
                print(f"(package {name} is not installed)", file=sys.stderr)
        spent = interleaved(tasks, max(5, min(repeats, 3_000_000 // count)))
        base = spent["NumPy, float64"]
        for name, times in spent.items():
            pairs = list(zip(base, times, strict=True))
            clock, processor = (
                1e9 / count * statistics.median(values)
                for values in ([one.clock for one in times], [one.processor for one in times])
            )
            by_clock = statistics.median(theirs.clock / mine.clock for theirs, mine in pairs)
            by_processor = statistics.median(theirs.processor / mine.processor for theirs, mine in pairs)
            print(f"| {count} | {name} | {clock:.1f} | {processor:.1f} | {by_clock:.2f} | {by_processor:.2f} |")


def resident_bytes(peak: bool) -> int:
    """Memory of this process, or its peak so far."""
    wanted = "VmHWM" if peak else "VmRSS"
    status = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in status if line.startswith(wanted)))


def memory_of(count: int) -> float:
    """Bytes a particle at the peak of some cycles, measured in this process: to be called in a fresh one."""
    field = a_field()
    ours(field, 20_000)()
    before = resident_bytes(peak=False)
    cycle = ours(field, count)
    for _ in range(4):
        cycle()
    return (resident_bytes(peak=True) - before) / count


def filter_memory(count: int = 1_000_000) -> None:
    """Print the memory a particle takes."""
    if not Path("/proc/self/status").exists():
        return
    script = "import sys; sys.path.insert(0, sys.argv[1]); import benchmark_filter as b; print(b.memory_of(int(sys.argv[2])))"
    command = [sys.executable, "-c", script, str(Path(__file__).parent), str(count)]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    print(f"\nMemory at the peak of a cycle with {count} particles: {float(out):.1f} bytes a particle")


def main() -> None:
    """Run the benchmark of the filter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--repeats", type=int, default=30)
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} cores, one thread unless said, {arguments.repeats} repeats (fewer of many particles)")
    filter_speed(arguments.particles, arguments.repeats)
    filter_memory()


if __name__ == "__main__":
    main()

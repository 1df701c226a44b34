"""What was done to a localizer by random faults, and what became of it: counts that add up over the parts of a long run."""

from __future__ import annotations

import resource
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.geometry import angle_difference

Float64 = NDArray[np.float64]

#: Wrong beyond these, an answer that is called converged is false; and for more than so many images in a row it must not be.
WRONG_M, WRONG_DEG, MOST_IN_ROW = 1.0, 20.0, 3
_MOST_GROWTH = 0.05


@dataclass
class Findings:
    """What was done to a localizer, and what became of it.

    Parameters
    ----------
    updates : int
        Images.
    faults : counter of str
        How often each was done.
    raised, broken : counter of str
        What must not be.
    failed_after : counter of str
        Images at which something was raised or broken, by the fault that came last.
    statuses : counter of str
    wrong : int
        Answers that were sure and wrong.
    wrong_after : counter of str
        The same by the fault that came last.
    runs : counter of str
        Of these answers in a row, by how many there were.
    in_row : int
        How many there are in the run that is not over.
    last_fault : str
    seconds : float
        Of the processor.
    memory_mb : (float, float)
        Of this process after its warm-up and now.
    grown_before : float
        The greatest growth, as a share, in processes before this one.
    """

    updates: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    raised: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    failed_after: Counter[str] = field(default_factory=Counter)
    statuses: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    wrong_after: Counter[str] = field(default_factory=Counter)
    runs: Counter[str] = field(default_factory=Counter)
    in_row: int = 0
    last_fault: str = "none"
    seconds: float = 0.0
    memory_mb: tuple[float, float] = (0.0, 0.0)
    grown_before: float = 0.0

    def befell(self, fault: str) -> None:
        """Count a fault."""
        self.faults[fault] += 1
        self.last_fault = fault

    def take(self, estimate: Estimate, true: Float64, broken: list[str]) -> None:
        """Count an answer, beside the true pose and what does not hold of it."""
        self.statuses[estimate.status.value] += 1
        self.broken.update(broken)
        self.failed_after[self.last_fault] += bool(broken)
        if estimate.status is Status.CONVERGED and _is_off(estimate.pose, true):
            self.wrong += 1
            self.wrong_after[self.last_fault] += 1
            self.in_row += 1
        else:
            self._end_run()

    def failed(self, error: Exception) -> None:
        """Count an error."""
        self.raised[f"{type(error).__name__} after {self.last_fault}"] += 1
        self.failed_after[self.last_fault] += 1

    def _end_run(self) -> None:
        if self.in_row:
            self.runs[str(self.in_row)] += 1
        self.in_row = 0

    @property
    def lengths(self) -> dict[int, int]:
        """How many runs of answers that were sure and wrong there are of each length, the last one included."""
        found = Counter({int(length): count for length, count in self.runs.items()})
        found.update([self.in_row] if self.in_row else [])
        return dict(found)

    @property
    def too_long(self) -> int:
        """Answers that were sure and wrong later in a row than allowed."""
        return sum(count * max(length - MOST_IN_ROW, 0) for length, count in self.lengths.items())

    @property
    def long_runs(self) -> tuple[int, int]:
        """How many runs were longer than allowed, and the longest of all."""
        return sum(count for length, count in self.lengths.items() if length > MOST_IN_ROW), max(self.lengths, default=0)

    @property
    def growth(self) -> float:
        """Of the memory after the warm-up, as a share; the greatest of all processes that had a part in it."""
        before, after = self.memory_mb
        return max(after / before - 1.0, self.grown_before) if before else self.grown_before

    def warmed_up(self) -> None:
        """From here on memory must not grow."""
        self.memory_mb = memory_mb(), 0.0

    def faults_found(self) -> list[str]:
        """Everything that must not be, one line each."""
        lines = [f"{what}: {count}" for what, count in (self.raised + self.broken).items()]
        if self.growth > _MOST_GROWTH:
            lines.append(f"memory grew by {100.0 * self.growth:.1f} %")
        return lines

    def data(self) -> dict[str, Any]:
        """All of it, as plain values; another process goes on with its memory anew."""
        values = {name: dict(value) if isinstance(value, Counter) else value for name, value in vars(self).items()}
        return values | {"grown_before": self.growth}

    @classmethod
    def of_data(cls, values: Mapping[str, Any]) -> Self:
        """What `data` gave.

        Raises
        ------
        TypeError
            Of something else.
        """
        taken: dict[str, Any] = {name: Counter(value) if isinstance(value, dict) else value for name, value in values.items()}
        return cls(**taken | {"memory_mb": (0.0, 0.0)})


def _is_off(pose: Float64, true: Float64) -> bool:
    far = float(np.hypot(*(pose[:2] - true[:2]))) > WRONG_M
    return far or abs(float(np.degrees(angle_difference(pose[2], true[2])))) > WRONG_DEG


def memory_mb() -> float:
    """Of this process now, megabytes; the most it ever had where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:  # noqa: PTH123
            return int(stream.read().split()[1]) * resource.getpagesize() / 2**20
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)

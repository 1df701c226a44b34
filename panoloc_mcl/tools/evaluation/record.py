"""What one run over one sequence left behind, as the figures need it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.tools.evaluation.definitions import STATUSES


def group_of(name: str) -> str:
    """The group of a sequence: its name up to the last underscore, ``noon`` of ``noon_00``; the whole name if it has none."""
    return name.rpartition("_")[0] or name


@dataclass(frozen=True, eq=False)
class SequenceRecord:
    """Estimates of one run over one sequence, one entry a frame.

    Parameters
    ----------
    name : str
        Of the sequence. Sequences of one group share it up to the last underscore.
    run : int
        0 for the first run over the sequence.
    times : ndarray of float64, shape (n,)
        Stamps of the frames, seconds, strictly increasing; n >= 1.
    poses : ndarray of float64, shape (n, 3)
        Estimates ``(x, y, theta)`` in the map frame, metres and radians.
    truth : ndarray of float64, shape (n, 3), or None
        True poses at the same stamps; not a number in the rows of frames without. None where no frame has one.
    status : tuple of str, length n
        Each of searching, converged, ambiguous, lost, stale.
    best_place : ndarray of int64, shape (n,)
        Index of the reported place, -1 for none.
    step_ms : ndarray of float64, shape (n,)
        Milliseconds from pixels to pose; NaN where none were measured.
    kidnapped : ndarray of bool, shape (n,)
        True at the first frame after a teleport; never at frame 0.
    covariances : ndarray of float64, shape (n, 3, 3), or None
        That were claimed of the poses, metres and radians; NaN where none were. None where nobody says.

    Raises
    ------
    ResultsError
        Lengths that differ, values out of range or not finite; all faults at once.
    """

    name: str
    run: int
    times: FloatArray
    poses: FloatArray
    truth: FloatArray | None
    status: tuple[str, ...]
    best_place: NDArray[np.int64]
    step_ms: FloatArray
    kidnapped: NDArray[np.bool_]
    covariances: FloatArray | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "times", np.asarray(self.times, dtype=np.float64))
        put(self, "poses", np.asarray(self.poses, dtype=np.float64))
        put(self, "truth", None if self.truth is None else np.asarray(self.truth, dtype=np.float64))
        put(self, "status", tuple(self.status))
        put(self, "best_place", np.asarray(self.best_place, dtype=np.int64))
        put(self, "step_ms", np.asarray(self.step_ms, dtype=np.float64))
        put(self, "kidnapped", np.asarray(self.kidnapped, dtype=np.bool_))
        put(self, "covariances", None if self.covariances is None else np.asarray(self.covariances, dtype=np.float64))
        # Values are only looked at once the shapes are right.
        faults = list(self._shape_faults()) or list(self._value_faults())
        if faults:
            raise ResultsError(f"sequence '{self.name}', run {self.run}: {fault}" for fault in faults)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def has_truth(self) -> NDArray[np.bool_]:
        """Frames whose true pose is known, shape (n,)."""
        return np.zeros(len(self), dtype=np.bool_) if self.truth is None else np.asarray(np.isfinite(self.truth).all(axis=1))

    @property
    def judged(self) -> SequenceRecord | None:
        """The same with the frames alone whose true pose is known; None if there are none.

        A teleport at a frame that is left out counts at the next.
        """
        known = self.has_truth
        if known.all() or not known.any():
            return self if known.any() else None
        rows = np.flatnonzero(known)
        before = np.concatenate([[0], np.cumsum(self.kidnapped)])[rows + 1]
        arrays: dict[str, Any] = {
            name: getattr(self, name)[known] for name in ("times", "poses", "truth", "best_place", "step_ms")
        }
        if self.covariances is not None:
            arrays["covariances"] = self.covariances[known]
        kidnapped = np.concatenate([[False], np.diff(before) > 0])
        return replace(self, **arrays, status=tuple(self.status[row] for row in rows), kidnapped=kidnapped)

    @property
    def group(self) -> str:
        """Name up to the last underscore; the whole name if it has none."""
        return group_of(self.name)

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Frames whose status is ``converged``, shape (n,)."""
        return np.array([status == "converged" for status in self.status], dtype=np.bool_)

    @property
    def first_converged(self) -> int | None:
        """Index of the first converged frame, None if there is none."""
        return self.status.index("converged") if "converged" in self.status else None

    @property
    def position_error_m(self) -> FloatArray | None:
        """Distance from the true position, metres, shape (n,); None without truth."""
        if self.truth is None:
            return None
        return np.hypot(self.poses[:, 0] - self.truth[:, 0], self.poses[:, 1] - self.truth[:, 1])

    @property
    def heading_error_deg(self) -> FloatArray | None:
        """Turn from the true heading without its sign, degrees in [0, 180], shape (n,); None without truth."""
        if self.truth is None:
            return None
        return np.abs(np.degrees(angle_difference(self.poses[:, 2], self.truth[:, 2])))

    def _shape_faults(self) -> Iterator[str]:
        n = self.times.shape[0] if self.times.ndim == 1 else -1
        if n < 0:
            yield f"times has shape {self.times.shape}; give one stamp a frame, shape (n,)"
            return
        if n == 0:
            yield "holds no frame; leave out sequences that gave none"
            return
        if len(self.status) != n:
            yield f"status has {len(self.status)} entries for {n} frames; give one a frame"
        wanted = {
            "poses": (n, 3),
            "truth": (n, 3),
            "best_place": (n,),
            "step_ms": (n,),
            "kidnapped": (n,),
            "covariances": (n, 3, 3),
        }
        for field, shape in wanted.items():
            value = getattr(self, field)
            if value is not None and value.shape != shape:
                yield f"{field} has shape {value.shape} for {n} frames; give {shape}"

    def _value_faults(self) -> Iterator[str]:
        if not self.name:
            yield "the name is empty; name the sequence"
        if self.run < 0:
            yield f"run = {self.run}; count runs from 0"
        for field in ("times", "poses", "truth"):
            value = getattr(self, field)
            if field == "truth" and value is not None:
                value = value[~np.isnan(value).all(axis=1)]
            if value is not None and not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0][0])
                yield f"{field}, frame {row}: {value[row]} is not finite; every frame needs numbers"
        steps = np.flatnonzero(~(np.diff(self.times) > 0))
        if np.isfinite(self.times).all() and len(steps):
            row = int(steps[0]) + 1
            yield f"times, frame {row}: {self.times[row]} does not follow {self.times[row - 1]}; stamps must increase"
        for row, status in enumerate(self.status):
            if status not in STATUSES:
                yield f"status, frame {row}: '{status}'; use one of {', '.join(STATUSES)}"
                break
        if (self.best_place < -1).any():
            row = int(np.flatnonzero(self.best_place < -1)[0])
            yield f"best_place, frame {row}: {self.best_place[row]}; use -1 for none"
        if (self.step_ms < 0).any() or np.isinf(self.step_ms).any():
            row = int(np.flatnonzero((self.step_ms < 0) | np.isinf(self.step_ms))[0])
            yield f"step_ms, frame {row}: {self.step_ms[row]}; use milliseconds, NaN where not measured"
        if self.kidnapped[0]:
            yield "kidnapped, frame 0: nothing comes before the first frame; mark the first frame after each teleport"

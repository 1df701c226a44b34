"""Errors beside what was claimed of them, of the drives of one condition; kept on disk, so that a long study goes on where it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from panoloc_mcl.laboratory.reports import Number
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.robot.source import source_digest
from panoloc_mcl.tools.evaluation import consistency

#: What claims depend on, beside data and settings.
_SOURCE = ("robot/", "laboratory/corruptions/", "laboratory/studies/claims.py", "laboratory/studies/consistency.py")


@dataclass
class Claims:
    """Errors and claimed covariances: of single images, and of the filter where it is sure.

    Parameters
    ----------
    drives : set of str
    images : int
    alone, filtered : list of float (12,)
        Error (x, y, heading: metres and radians), and the covariance that was claimed, row by row.
    """

    drives: set[str] = field(default_factory=set)
    images: int = 0
    alone: list[list[float]] = field(default_factory=list)
    filtered: list[list[float]] = field(default_factory=list)

    def take(self, drive: str, estimate: Estimate, truth: FloatArray) -> None:
        """One answer."""
        self.drives.add(drive)
        self.images += 1
        votes = estimate.vote_field
        if votes is not None and votes.informative and votes.measurement is not None:
            self.alone.append(_beside(votes.measurement.pose, truth, votes.measurement.covariance))
        if estimate.status is Status.CONVERGED:
            self.filtered.append(_beside(estimate.pose, truth, estimate.covariance))

    def add(self, other: Claims) -> None:
        """Those of another drive."""
        self.drives |= other.drives
        self.images += other.images
        self.alone += other.alone
        self.filtered += other.filtered

    def cells(self) -> list[Any]:
        """Of its row."""
        return [len(self.drives), self.images, *_held(self.alone), *_held(self.filtered)]

    def data(self) -> dict[str, Any]:
        """All of it, as plain values."""
        return {"drives": sorted(self.drives), "images": self.images, "alone": self.alone, "filtered": self.filtered}

    @classmethod
    def of_data(cls, values: dict[str, Any]) -> Self:
        """What `data` gave."""
        return cls(set(values["drives"]), int(values["images"]), values["alone"], values["filtered"])


def kept(folder: Path | None, description: Iterable[object], compute: Callable[[], Claims]) -> Claims:
    """The claims of a folder that belong to a description and to this source, or else computed and kept there.

    Parameters
    ----------
    folder : Path or None
        None: nothing is kept.
    description : iterable
        All that they depend on besides the source; its text counts.
    compute : callable
    """
    if folder is None:
        return compute()
    text = json.dumps([source_digest(_SOURCE), *map(str, description)])
    path = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"
    if path.is_file():
        try:
            return Claims.of_data(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, KeyError, TypeError):
            # Of a disk that was full, or edited: computed again.
            pass
    claims = compute()
    write_atomically(path, json.dumps(claims.data()))
    return claims


def _beside(pose: FloatArray, truth: FloatArray, covariance: FloatArray) -> list[float]:
    off = pose - truth
    off[2] = angle_difference(pose[2], truth[2])
    return [*off.tolist(), *covariance.ravel().tolist()]


def _held(claims: list[list[float]]) -> list[Number]:
    values = np.array(claims, dtype=np.float64).reshape(-1, 12)
    errors = values[:, :3]
    held = consistency(errors, values[:, 3:].reshape(-1, 3, 3))
    median = float(np.median(np.hypot(errors[:, 0], errors[:, 1]))) * 1000.0 if len(errors) else None
    cells = [Number(median, 1)]
    for axis in ("position", "heading"):
        inside = held[axis]["inside_2sd"]
        cells += [Number(held[axis]["nees_median"], 2), Number(None if inside is None else 100.0 * inside, 0)]
    return cells

"""What single images say by themselves, method beside method: paired image by image, with intervals over drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.comparison.runs import Runs
from panoloc_mcl.laboratory.comparison.summaries.tables import METHOD, Entry
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import bootstrap95, interval95_over_drives, quantile95_over_drives
from panoloc_mcl.tools.evaluation.tables import BLANK, interval, percent

# An image is right within this; headings are not judged, since few recordings know them.
RIGHT_M = 1.0
HEADS = (
    "data set",
    "method",
    "images, drives",
    "within 1 m % (95 %)",
    "more than the baseline, points (95 %)",
    "position mm (95 %): median",
    "p95",
    "filter: converged %",
    "lost %",
    "position mm: median / p95",
    "sure and wrong",
)


@dataclass(frozen=True, eq=False)
class _Images:
    """All images of one condition and method: drives, errors of the best guesses, and of the filter's answers with its status."""

    drives: tuple[str, ...]
    alone: FloatArray
    filtered: FloatArray
    status: tuple[str, ...]

    @property
    def right(self) -> NDArray[np.bool_]:
        return np.asarray(self.alone <= RIGHT_M)

    def of_drives(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Values of images, drive by drive."""
        drives = np.array(self.drives)
        return [values[drives == drive] for drive in dict.fromkeys(self.drives)]


def single_images(entries: Sequence[Entry], baseline: str | None) -> list[str]:
    """The table; none where no images were overheard. Lights are pooled, and each image counts once, with the first seed.

    Parameters
    ----------
    entries : sequence of Entry
    baseline : str or None
        Method that the others are paired with, as the table names it; None = the first.
    """
    varying = [name for name in METHOD if len({entry.method[name] for entry in entries}) > 1]
    lights: dict[tuple[str, str], dict[str, _Images]] = {}
    for entry in entries:
        if not isinstance(entry.result, Runs) or not entry.result.answers:
            continue
        if not any(np.isfinite(answers.guesses).any() for answers in entry.result.answers):
            # The mode asks images about some headings only.
            continue
        place = entry.condition["dataset"], entry.condition["corruption"]
        condition = place[0] if place[1] == "clean" else ", ".join(place)
        method = ", ".join(entry.method[name] for name in varying) or entry.method["observation"]
        found = _images(entry.result)
        if found is not None:
            lights.setdefault((condition, method), {}).setdefault(entry.condition["light"], found)
    rows = {key: _pooled(list(parts.values())) for key, parts in lights.items()}
    if not rows:
        return []
    first = baseline or next(iter(rows))[1]
    lines = [f"| {' | '.join(HEADS)} |", f"|{'---|' * len(HEADS)}"]
    for (condition, method), images in rows.items():
        other = rows.get((condition, first))
        lines.append(f"| {' | '.join([condition, method, *_cells(images, None if method == first else other)])} |")
    return lines


def _images(runs: Runs) -> _Images | None:
    parts = []
    for record, answers in zip(runs.records, runs.answers, strict=True):
        known = record.has_truth
        if record.truth is None or not known.any():
            continue
        off = answers.guesses[known, :2] - record.truth[known, :2]
        alone = np.where(np.isnan(off).any(axis=1), np.inf, np.hypot(*off.T))
        filtered = np.hypot(*(record.poses[known, :2] - record.truth[known, :2]).T)
        parts.append(_Images((record.name,) * len(alone), alone, filtered, tuple(np.array(record.status)[known].tolist())))
    return _pooled(parts) if parts else None


def _pooled(parts: Sequence[_Images]) -> _Images:
    return _Images(
        tuple(drive for part in parts for drive in part.drives),
        np.concatenate([part.alone for part in parts]),
        np.concatenate([part.filtered for part in parts]),
        tuple(status for part in parts for status in part.status),
    )


def _cells(images: _Images, baseline: _Images | None) -> list[str]:
    count, hits = len(images.alone), int(images.right.sum())
    right = zip(*((int(part.sum()), len(part)) for part in images.of_drives(images.right)), strict=True)
    status = np.array(images.status)
    sure = images.filtered[status == "converged"]
    paired = BLANK
    if baseline is not None and baseline.drives == images.drives:
        won, lost = (int(np.sum(a & ~b)) for a, b in ((images.right, baseline.right), (baseline.right, images.right)))
        of_drives = images.of_drives(images.right.astype(np.float64) - baseline.right)
        bounds = bootstrap95([float(np.mean(part)) for part in of_drives])
        told = f"{100.0 * bounds[0]:+.1f} to {100.0 * bounds[1]:+.1f}; " if len(of_drives) > 1 else ""
        paired = f"{100.0 * (won - lost) / count:+.1f} ({told}won {won}, lost {lost})"
    quantiles = [_quantile(images, share) for share in (0.5, 0.95)]
    return [
        f"{count}, {len(set(images.drives))}",
        f"{percent(hits / count)} ({interval(interval95_over_drives(*right))})",
        paired,
        *quantiles,
        percent(float(np.mean(status == "converged"))),
        percent(float(np.mean(status == "lost"))),
        BLANK if not len(sure) else " / ".join(f"{1000.0 * np.quantile(sure, q):.1f}" for q in (0.5, 0.95)),
        f"{int(np.sum(sure > RIGHT_M))}/{count}",
    ]


def _quantile(images: _Images, share: float) -> str:
    """A quantile of errors in millimetres, with its interval over drives; those that say nothing err without end."""
    millimetres = 1000.0 * images.alone
    found = f"{float(np.quantile(millimetres, share, method='inverted_cdf')):.1f}"
    bounds = quantile95_over_drives(millimetres, images.drives, share)
    return found if bounds is None else f"{found} ({bounds[0]:.1f} to {bounds[1]:.1f})"

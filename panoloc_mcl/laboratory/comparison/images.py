"""What single images say by themselves, method beside method, with intervals over images.

For maps that few drives were recorded in: an interval over one drive says nothing, but whether one method finds more of the same images
than another can be asked image by image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

from panoloc_mcl.laboratory.comparison.runs import Runs
from panoloc_mcl.laboratory.comparison.summaries.tables import METHOD, Entry
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation import wilson95
from panoloc_mcl.tools.evaluation.tables import BLANK, interval, percent

# An image is right within this; headings are not judged, since few recordings know them.
RIGHT_M = 1.0
HEADS = (
    "data set",
    "method",
    "images",
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
    """All images of one condition and method: errors of their best guesses, and of the filter's answers with its status."""

    alone: FloatArray
    filtered: FloatArray
    status: tuple[str, ...]

    @property
    def right(self) -> NDArray[np.bool_]:
        return np.asarray(self.alone <= RIGHT_M)


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
        parts.append(_Images(alone, filtered, tuple(np.array(record.status)[known].tolist())))
    return _pooled(parts) if parts else None


def _pooled(parts: Sequence[_Images]) -> _Images:
    return _Images(
        np.concatenate([part.alone for part in parts]),
        np.concatenate([part.filtered for part in parts]),
        tuple(status for part in parts for status in part.status),
    )


def _cells(images: _Images, baseline: _Images | None) -> list[str]:
    count, hits = len(images.alone), int(images.right.sum())
    status = np.array(images.status)
    sure = images.filtered[status == "converged"]
    paired = BLANK
    if baseline is not None and len(baseline.alone) == count:
        won, lost = (int(np.sum(a & ~b)) for a, b in ((images.right, baseline.right), (baseline.right, images.right)))
        low, high = paired_difference95(hits, won, lost, count)
        paired = f"{100.0 * (won - lost) / count:+.1f} ({100.0 * low:+.1f} to {100.0 * high:+.1f}; won {won}, lost {lost})"
    quantiles = [_quantile(images.alone, share) for share in (0.5, 0.95)]
    return [
        str(count),
        f"{percent(hits / count)} ({interval(wilson95(hits, count))})",
        paired,
        *quantiles,
        percent(float(np.mean(status == "converged"))),
        percent(float(np.mean(status == "lost"))),
        BLANK if not len(sure) else " / ".join(f"{1000.0 * np.quantile(sure, q):.1f}" for q in (0.5, 0.95)),
        f"{int(np.sum(sure > RIGHT_M))}/{count}",
    ]


def _quantile(metres: FloatArray, share: float) -> str:
    """A quantile of errors in millimetres, with its interval by bootstrap over images; those that say nothing err without end."""
    millimetres = 1000.0 * np.where(np.isfinite(metres), metres, 1e9)

    def of(sample: FloatArray, axis: int) -> FloatArray:
        return np.asarray(np.quantile(sample, share, axis=axis))

    found = bootstrap((millimetres,), of, n_resamples=2000, method="percentile", rng=np.random.default_rng(0))
    low, high = found.confidence_interval
    return f"{float(np.quantile(millimetres, share)):.1f} ({float(low):.1f} to {float(high):.1f})"


def paired_difference95(hits: int, won: int, lost: int, count: int) -> tuple[float, float]:
    """95 % interval of the difference of two rates over the same trials (Newcombe 1998, Statistics in Medicine 17, method 10).

    Parameters
    ----------
    hits : int
        Successes of the first.
    won, lost : int
        Trials that only the first, and only the second succeeded in.
    count : int
        Trials, at least one.
    """
    both = hits - won
    theirs = both + lost
    neither = count - both - won - lost
    a, b = hits / count, theirs / count
    mine, other = wilson95(hits, count), wilson95(theirs, count)
    assert mine is not None
    assert other is not None
    spread = math.sqrt(float(hits) * (count - hits) * theirs * (count - theirs))
    product = both * neither - won * lost
    # With the correction for continuity that makes it method 10.
    alike = 0.0 if spread == 0.0 else (max(product - 0.5 * count, 0.0) if product > 0 else product) / spread
    down = _side(a - mine[0], other[1] - b, alike)
    up = _side(mine[1] - a, b - other[0], alike)
    return a - b - down, a - b + up


def _side(first: float, second: float, alike: float) -> float:
    return math.sqrt(max(first * first - 2.0 * alike * first * second + second * second, 0.0))

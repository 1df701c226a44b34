"""What imperfections of recordings do: one line a data set and recipe, for single images and for the filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.comparison.runs import Answers, Runs
from panoloc_mcl.laboratory.comparison.summaries.tables import METHOD, Entry
from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.robot.geometry import FloatArray, angle_difference, wrap_angle
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate
from panoloc_mcl.tools.evaluation.tables import BLANK, number, out_of, percent

Bools = NDArray[np.bool_]

# One image is right within these (method of `global_success`), and an answer is sure and wrong beyond those of `false_convergence`.
_RIGHT_M, _RIGHT_DEG = 0.5, 10.0
_WRONG_M, _WRONG_DEG = 1.0, 20.0
_ALIGNMENT_ROUNDS = 10
# Of metres, and decimals.
_MM = (1000.0, 1)
# Errors beyond so many medians, and beyond a centimetre, do not count where the frame is fitted.
_OUTLYING, _LEAST_OUTLYING_M = 3.0, 0.01

HEADS = (
    "data set",
    "recipe",
    "one image: right %",
    "median / p95, mm",
    "filter: found itself",
    "median / p95, mm",
    "aligned, mm",
    "heading median / p95, °",
    "aligned, °",
    "sure and wrong: images %",
    "runs",
    "NEES, within 2 sd %",
)


def has_imperfections(entries: Sequence[Entry]) -> bool:
    """Whether any recipe changes the data set."""
    return any(parse_recipe(recipe).changes_data for recipe in {entry.condition["corruption"] for entry in entries})


def imperfections(entries: Sequence[Entry]) -> list[str]:
    """The table, lights and seeds pooled; methods apart where there are several."""
    methods = {tuple(entry.method[name] for name in METHOD) for entry in entries}
    parts: dict[tuple[str, ...], list[Entry]] = {}
    for entry in entries:
        recipe = entry.condition["corruption"]
        label = recipe if len(methods) == 1 else f"{recipe}, {', '.join(_varying(entry, methods))}"
        parts.setdefault((entry.condition["dataset"], label), []).append(entry)
    lines = [f"| {' | '.join(HEADS)} |", f"|{'---|' * len(HEADS)}"]
    for key, part in parts.items():
        lines.append(f"| {' | '.join([*key, *_cells(part)])} |")
    return lines


def _varying(entry: Entry, methods: set[tuple[str, ...]]) -> list[str]:
    return [entry.method[name] for index, name in enumerate(METHOD) if len({method[index] for method in methods}) > 1]


def _cells(entries: Sequence[Entry]) -> list[str]:
    found = [(entry.seed, entry.result) for entry in entries if isinstance(entry.result, Runs)]
    if not found:
        why = next(str(entry.result.text) for entry in entries if not isinstance(entry.result, Runs))
        return [f"failed: {_short(why)}", *[BLANK] * (len(HEADS) - 3)]
    runs = [Watched(seed, *pair) for seed, run in found for pair in _judged(run)]
    if not runs:
        return ["no truth", *[BLANK] * (len(HEADS) - 3)]
    records = [watched.record for watched in runs]
    numbered = [SequenceRecord(**{**vars(record), "run": index}) for index, record in enumerate(records)]
    metrics = evaluate(numbered, None)["overall"]
    success, wrong = metrics["global_success"], metrics["false_convergence"]
    alone = [watched.alone for watched in runs if watched.answers is not None]
    metres, degrees = (np.concatenate([part[axis] for part in alone]) if alone else np.zeros(0) for axis in (0, 1))
    right = (metres <= _RIGHT_M) & (degrees <= _RIGHT_DEG)
    sure_wrong = np.concatenate([watched.sure_and_wrong for watched in runs])
    claimed = metrics["consistency"]["position"]
    framed_m, framed_deg = aligned(runs)
    return [
        percent(float(np.mean(right))) if len(right) else BLANK,
        _spread(metres[np.isfinite(metres)], *_MM),
        out_of(success["succeeded"], success["runs"]),
        _spread(np.concatenate([watched.after[0] for watched in runs]), *_MM),
        _spread(framed_m, *_MM),
        _pair(metrics["heading_median_deg"], metrics["heading_p95_deg"], 2),
        _spread(framed_deg, 1.0, 2),
        percent(float(np.mean(sure_wrong))),
        out_of(wrong["count"], wrong["runs"]),
        BLANK
        if claimed["nees_median"] is None
        else f"{number(claimed['nees_median'], 2)}, {percent(claimed['inside_2sd'], 0)}",
    ]


@dataclass(frozen=True, eq=False)
class Watched:
    """A run with truth, and what its images said by themselves.

    Parameters
    ----------
    seed : int or None
        Runs of one seed share their map.
    record : SequenceRecord
    answers : Answers or None
    """

    seed: int | None
    record: SequenceRecord
    answers: Answers | None

    @property
    def errors(self) -> tuple[FloatArray, FloatArray]:
        """Metres and degrees, one an image."""
        metres, degrees = self.record.position_error_m, self.record.heading_error_deg
        assert metres is not None
        assert degrees is not None
        return metres, degrees

    @property
    def counts(self) -> Bools:
        """Images from the first converged one on."""
        first = self.record.first_converged
        return np.arange(len(self.record)) >= (len(self.record) if first is None else first)

    @property
    def after(self) -> tuple[FloatArray, FloatArray]:
        """Errors after convergence."""
        metres, degrees = self.errors
        return metres[self.counts], degrees[self.counts]

    @property
    def alone(self) -> tuple[FloatArray, FloatArray]:
        """Errors of what the images say by themselves; endless where they say nothing."""
        assert self.answers is not None
        assert self.record.truth is not None
        off = self.answers.poses[:, :2] - self.record.truth[:, :2]
        metres = np.where(np.isnan(off).any(axis=1), np.inf, np.hypot(off[:, 0], off[:, 1]))
        degrees = np.degrees(np.abs(angle_difference(self.answers.poses[:, 2], self.record.truth[:, 2])))
        return metres, np.where(np.isnan(degrees), np.inf, degrees)

    @property
    def sure_and_wrong(self) -> Bools:
        """Images after which the filter is sure of a pose that is wrong."""
        metres, degrees = self.errors
        return self.record.converged & ((metres > _WRONG_M) | (degrees > _WRONG_DEG))


def aligned(runs: Sequence[Watched]) -> tuple[FloatArray, FloatArray]:
    """Errors after convergence, the frame of every map (runs of one seed) turned and shifted onto the true one.

    Parameters
    ----------
    runs : sequence of Watched

    Returns
    -------
    metres, degrees : (n,) float64
        Position errors, and absolute heading errors after the same turn.
    """
    metres, degrees = [np.zeros(0)], [np.zeros(0)]
    for seed in dict.fromkeys(watched.seed for watched in runs):
        mine = [watched for watched in runs if watched.seed == seed]
        said = np.concatenate([watched.record.poses[watched.counts] for watched in mine])
        true = np.concatenate([watched.record.truth[watched.counts] for watched in mine if watched.record.truth is not None])
        moved, turn = _fitted(said[:, :2], true[:, :2])
        metres.append(np.hypot(*(true[:, :2] - moved).T))
        degrees.append(np.degrees(np.abs(angle_difference(said[:, 2] + turn, true[:, 2]))))
    return np.concatenate(metres), np.concatenate(degrees)


def _fitted(said: FloatArray, true: FloatArray) -> tuple[FloatArray, float]:
    """Positions (n, 2) after the turn and shift that bring most of them nearest to the true ones, and that turn; radians."""
    moved, turn = said, 0.0
    for _ in range(_ALIGNMENT_ROUNDS):
        errors = np.hypot(*(true - moved).T)
        if len(errors) < 3:
            return said, 0.0
        near = errors <= max(_OUTLYING * float(np.median(errors)), _LEAST_OUTLYING_M)
        a, b = said[near] - said[near].mean(axis=0), true[near] - true[near].mean(axis=0)
        turn = float(wrap_angle(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))))
        c, s = np.cos(turn), np.sin(turn)
        moved = (said - said[near].mean(axis=0)) @ np.array([[c, s], [-s, c]]) + true[near].mean(axis=0)
    return np.asarray(moved), turn


def _judged(runs: Runs) -> list[tuple[SequenceRecord, Answers | None]]:
    """Records with the images alone whose true pose is known, and what these said."""
    pairs = []
    for index, record in enumerate(runs.records):
        judged = record.judged
        if judged is not None:
            known = record.has_truth
            said = runs.answers[index] if runs.answers else None
            pairs.append((judged, None if said is None else said.of(known)))
    return pairs


def _spread(values: FloatArray, scale: float, digits: int) -> str:
    if not len(values):
        return BLANK
    median, p95 = np.percentile(values, (50, 95))
    return _pair(scale * float(median), scale * float(p95), digits)


def _pair(first: float | None, second: float | None, digits: int) -> str:
    return f"{number(first, digits)} / {number(second, digits)}"


def _short(text: str) -> str:
    return text if len(text) <= 100 else f"{text[:97]}…"

"""What a comparison says in the end: figures pooled by condition and method, and paired differences between methods."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.comparison.runs import Failure, Runs
from panoloc_mcl.laboratory.comparison.summaries.tables import CONDITION, METHOD, Entry, Row
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.evaluation import SequenceRecord, bootstrap95, evaluate

#: Label, unit, and how a run's row gives the figure; larger is better for the first two.
PAIRED: tuple[tuple[str, str], ...] = (
    ("success", "%"),
    ("recognition", "%"),
    ("position median", "mm"),
    ("heading median", "deg"),
    ("images to converge", ""),
)


@dataclass(frozen=True, eq=False)
class Group:
    """All runs of one method under one condition.

    Parameters
    ----------
    condition, method : str
        As the tables name them: what varies over the comparison.
    axes : mapping of str to str
        All of them.
    metrics : mapping or None
        From ``evaluate``, over all runs; None where every cell failed.
    records : tuple of SequenceRecord
    failures : tuple of str
        Why cells failed, one each.
    """

    condition: str
    method: str
    axes: Mapping[str, str]
    metrics: Mapping[str, Any] | None
    records: tuple[SequenceRecord, ...]
    failures: tuple[str, ...]


@dataclass(frozen=True)
class Difference:
    """How a figure of a method differs from the baseline's, run by run.

    Parameters
    ----------
    condition, method, baseline, figure, unit : str
    pairs, drives : int
        Runs that have the figure under both, and the drives that they are over.
    mean, low, high : float
        Mean difference, every drive counted alike, and its 95 % interval by bootstrap over drives (percentiles); infinite for one.
    """

    condition: str
    method: str
    baseline: str
    figure: str
    unit: str
    pairs: int
    drives: int
    mean: float
    low: float
    high: float


def groups_of(entries: Sequence[Entry]) -> list[Group]:
    """Entries by condition and method, in the order in which they first come."""
    varying = {name for name in CONDITION if len({entry.condition[name] for entry in entries}) > 1} | {
        name for name in METHOD if len({entry.method[name] for entry in entries}) > 1
    }
    parts: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        condition = label(entry.condition, varying & set(CONDITION)) or entry.condition["light"]
        method = label(entry.method, varying & set(METHOD)) or entry.method["observation"]
        parts.setdefault((condition, method), []).append(entry)
    return [_group(condition, method, part) for (condition, method), part in parts.items()]


def label(axes: Mapping[str, str], varying: set[str]) -> str:
    """The axes that vary, joined."""
    return ", ".join(value for name, value in axes.items() if name in varying)


def _group(condition: str, method: str, entries: Sequence[Entry]) -> Group:
    found = [entry.result for entry in entries if isinstance(entry.result, Runs)]
    records = [record for runs in found for record in runs.records]
    # One sequence is run with many seeds; as figures count, these are runs of it.
    numbered = tuple(replace(record, run=index) for index, record in enumerate(records))
    return Group(
        condition,
        method,
        {**entries[0].condition, **entries[0].method},
        evaluate(numbered, found[0].places)["overall"] if numbered else None,
        numbered,
        tuple(entry.result.text for entry in entries if isinstance(entry.result, Failure)),
    )


def differences(groups: Sequence[Group], rows: Sequence[Row], baseline: str | None) -> list[Difference]:
    """Every method against the baseline, condition by condition, paired by sequence and seed.

    Raises
    ------
    ConfigError
        A baseline that is no method.
    """
    methods = list(dict.fromkeys(group.method for group in groups))
    if baseline is not None and baseline not in methods:
        raise ConfigError(f"baseline = '{baseline}': is no method of this comparison; there are: {'; '.join(methods)}")
    first = baseline or methods[0]
    by_axes: dict[tuple[str, ...], dict[tuple[str, int | None], Row]] = {}
    for row in rows:
        if row["error"] is None:
            by_axes.setdefault(_key(row), {})[row["sequence"], row["seed"]] = row
    of = {(group.condition, group.method): by_axes.get(_key(group.axes), {}) for group in groups}
    found = []
    for group in groups:
        if group.method == first:
            continue
        mine, theirs = of[group.condition, group.method], of.get((group.condition, first), {})
        shared = [run for run in mine if run in theirs]
        for name, unit in PAIRED:
            of_drive: dict[str, list[float]] = {}
            for run in shared:
                a, b = _value(mine[run], name), _value(theirs[run], name)
                if a is not None and b is not None:
                    of_drive.setdefault(run[0], []).append(a - b)
            if of_drive:
                # Seeds over one drive are no new trials: the drives are what is drawn again.
                means = np.array([np.mean(values) for values in of_drive.values()])
                low, high = bootstrap95(means, zlib.crc32(f"{group.condition}|{group.method}|{name}".encode()))
                pairs = sum(map(len, of_drive.values()))
                found.append(
                    Difference(
                        group.condition, group.method, first, name, unit, pairs, len(means), float(means.mean()), low, high
                    )
                )
    return found


def _key(axes: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(str(axes[name]) for name in (*CONDITION, *METHOD))


def _value(row: Row, figure: str) -> float | None:
    """A run's figure in the unit of `PAIRED`; None where it does not apply."""
    if figure == "recognition":
        return 100.0 * row["recognised"] / row["passed"] if row["passed"] else None
    column, scale = {
        "success": ("succeeded", 100.0),
        "position median": ("position_median_m", 1000.0),
        "heading median": ("heading_median_deg", 1.0),
        "images to converge": ("frames_to_converge", 1.0),
    }[figure]
    return None if row[column] is None else scale * row[column]

"""How good maps are that mend themselves, are made of drives, and live on: the study.

Surveys with errors of every kind are mended, drives become maps, maps are brought up to date; keyframes are held against the truth, and
images of other drives are localized in the maps, nothing known. A cell is one row with one seed; a study that was stopped goes on where
it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.reports import Number, Rate, Report, Spread, Table
from panoloc_mcl.laboratory.studies.mapping.cells import Row, cell
from panoloc_mcl.laboratory.studies.mapping.judging import Values
from panoloc_mcl.laboratory.studies.mapping.surveys import SURVEYS
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.evaluation.definitions import BAD_HEADING_DEG, BAD_POSITION_M
from panoloc_mcl.tools.evaluation.record import group_of

# An image of which nothing is known is read rightly within this, with the map's frame on the true one.
_RIGHT_M, _RIGHT_DEG = 0.5, 10.0

Found = Sequence[tuple[Row, int, Values]]


def study(
    config: RunConfig,
    rows: Sequence[str] = tuple(SURVEYS),
    seeds: Sequence[int] = (0,),
    every: int = 6,
    progress: Progress = no_progress,
    keep: Callable[[Report], None] = lambda report: None,
) -> Report:
    """Make maps and localize in them.

    Parameters
    ----------
    config : RunConfig
        ``dataset``, ``sequences`` (those that are localized), ``observation``, ``localizer`` and ``map``.
    rows : sequence of str
        See `Row.parsed`.
    seeds : sequence of int
        Of the errors of surveys. Of drives, 0 takes odometry as it was recorded; others draw it anew from the true poses.
    every : int
        Localize every so many images; 0: look at the keyframes only, which takes half the time.
    progress : callable (done, total, what)
    keep : callable
        Called with the report after each cell.

    Raises
    ------
    ConfigError
        No such row.
    """
    chosen = [Row.parsed(text) for text in rows]
    dataset = read_dataset(resolve_dataset(config.dataset))
    cells = [(row, seed) for row in chosen for seed in seeds]
    found: list[tuple[Row, int, Values]] = []
    report = Report("")
    for done, (row, seed) in enumerate(cells):
        with threadpool_limits(1):
            found.append((row, seed, cell(config, dataset, row, seed, every, progress)))
        report = _report(dataset, found, every)
        keep(report)
        progress(done + 1, len(cells), "maps")
    return report


def _report(dataset: Dataset, found: Found, every: int) -> Report:
    seeds = sorted({seed for _, seed, _ in found})
    report = Report(
        f"Maps of `{dataset.name}`, seeds {', '.join(map(str, seeds))}: errors against the truth, with the map's frame turned and "
        f"shifted onto the true one{f'; localized is every {every}. image of drives that are not in the map' if every else ''}.",
        facts={"notes": {f"{row.text}, seed {seed}": _notes(values) for row, seed, values in found}},
    )
    _table_of_keyframes(report, found)
    if every:
        _table_of_images(report, found)
    return report


def _table_of_keyframes(report: Report, found: Found) -> None:
    heads = (
        "map",
        "seeds",
        "keyframes",
        "way, m",
        "given: mm, degrees",
        "map: mm, by seed",
        "largest, mm",
        "degrees, by seed",
        "not aligned, mm, by seed",
        "claimed sd, mm",
        "wrong / named / kept wrong / blamed",
        "loops / believed / false",
        "processor s",
    )
    table = report.table("Keyframes", heads, "Medians over the keyframes.")
    for row, name, mine in _by_map(found):
        maps = [values["maps"][name] for values in mine]
        counts = [sum(one[key] for one in maps) for key in ("wrong", "named", "kept_wrong", "blamed")]
        loops = [sum(one[key] for one in maps) for key in ("loops", "loops_believed", "loops_false")]
        given = np.median([one["given"] for one in maps], axis=0)
        table.add(
            _titled(row, name),
            len(maps),
            Number(float(np.median([one["keyframes"] for one in maps]))),
            Number(float(np.median([one["way_m"] for one in maps])), 1),
            f"{1000.0 * given[0]:.1f}, {given[2]:.2f}",
            _listed(1000.0 * one["mended"][0] for one in maps),
            Number(1000.0 * max(one["mended"][1] for one in maps)),
            _listed((one["mended"][2] for one in maps), 3),
            _listed(1000.0 * one["unaligned"][0] for one in maps),
            Number(1000.0 * float(np.median([one["claimed"][0] for one in maps])), 1),
            " / ".join(map(str, counts)) if counts[0] or counts[1] or counts[3] else None,
            " / ".join(map(str, loops)) if loops[0] else None,
            Number(float(np.median([values["seconds"] for values in mine]))),
        )


def _table_of_images(report: Report, found: Found) -> None:
    heads = (
        "map",
        "images of",
        "drives",
        "images",
        f"right: {_RIGHT_M:g} m, {_RIGHT_DEG:g} degrees (95 %)",
        "one image: mm, median / p95 / max",
        "degrees",
        "not aligned, mm",
        "filter sure, %",
        f"sure, off > {BAD_POSITION_M:g} m or {BAD_HEADING_DEG:g} degrees, %",
        "filter: mm",
    )
    note = "Nothing is known before an image; one that says nothing is infinitely wrong. Of the filter, only what it is sure of counts."
    table = report.table("Images localized in the maps", heads, note)
    for row, name, mine in _by_map(found):
        groups = dict.fromkeys(group_of(drive) for values in mine for drive in values["maps"][name]["localized"])
        for group in groups:
            _add_images(table, row, name, group, mine)


def _add_images(table: Table, row: Row, name: str, group: str, mine: Sequence[Values]) -> None:
    some = [
        (drive, errors)
        for values in mine
        for drive, errors in values["maps"][name]["localized"].items()
        if group_of(drive) == group
    ]
    right = [
        (drive, metres <= _RIGHT_M and degrees <= _RIGHT_DEG)
        for drive, errors in some
        for metres, degrees in zip(errors["image"]["m"], errors["image"]["deg"], strict=True)
    ]
    pooled = {
        (of, what): np.concatenate([np.array(errors[of][what]) for _, errors in some])
        for of in ("image", "filter")
        for what in ("m", "deg", "unaligned_m")
    }
    sure = np.isfinite(pooled["filter", "m"])
    wrong = sure & ((pooled["filter", "m"] > BAD_POSITION_M) | (pooled["filter", "deg"] > BAD_HEADING_DEG))
    table.add(
        _titled(row, name),
        group,
        len({drive for drive, _ in some}),
        len(right),
        Rate.over(right),
        Spread(1000.0 * pooled["image", "m"], 1),
        Spread(pooled["image", "deg"], 3),
        Spread(1000.0 * pooled["image", "unaligned_m"], 1),
        Number(100.0 * float(sure.mean())),
        Number(100.0 * float(wrong.mean()), 1),
        Spread(1000.0 * pooled["filter", "m"][sure], 1),
    )


def _by_map(found: Found) -> list[tuple[Row, str, list[Values]]]:
    """Every map of every row, with the figures of all seeds."""
    rows = dict.fromkeys(row for row, _, _ in found)
    grouped = {row: [values for other, _, values in found if other == row] for row in rows}
    return [(row, name, mine) for row, mine in grouped.items() for name in mine[0]["maps"]]


def _titled(row: Row, name: str) -> str:
    return f"{row.told}: {name}" if name else row.told


def _listed(values: Iterable[float], decimals: int = 1) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in values)


def _notes(values: Values) -> list[str]:
    return [note for one in values["maps"].values() for note in one["notes"]]

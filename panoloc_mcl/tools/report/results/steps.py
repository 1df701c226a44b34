"""``steps.csv``: one row a frame, what the localizer was and how long each stage took."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.tools.evaluation.record import SequenceRecord

#: Columns before the milliseconds of the stages; ``ms_total`` closes a row.
STEP_COLUMNS = (
    "timestamp",
    "status",
    "message",
    "particles",
    "n_eff",
    "spread_m",
    "spread_deg",
    "cov_xx",
    "cov_xy",
    "cov_xt",
    "cov_yy",
    "cov_yt",
    "cov_tt",
    "best_place",
    "best_place_votes",
    "margin",
    "resampled",
    "injected",
    "kidnapped",
)
#: Claimed covariance of the pose, upper triangle: square metres, metres times radians, square radians.
COVARIANCE = ("cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")
TOTAL = "ms_total"
STAGE_PREFIX = "ms_"

# What the figures are made of; a row takes these from the record, so that the two cannot disagree.
_FROM_RECORD = ("timestamp", "status", "best_place", "kidnapped", TOTAL)


@dataclass(frozen=True, eq=False)
class Steps:
    """The columns of ``steps.csv`` that the figures need; arrays of shape (n,), covariances (n, 3, 3) or None if none were kept."""

    times: FloatArray
    status: tuple[str, ...]
    best_place: NDArray[np.int64]
    step_ms: FloatArray
    kidnapped: NDArray[np.bool_]
    covariances: FloatArray | None


def steps_text(record: SequenceRecord, rows: Sequence[Mapping[str, Any]]) -> str:
    """The text of ``steps.csv``.

    Parameters
    ----------
    record : SequenceRecord
        Gives timestamp, status, best_place, kidnapped and ms_total.
    rows : sequence of mapping, one a frame
        The other columns of ``STEP_COLUMNS``, and ``ms_<stage>`` for each stage in the order of the work. What a row lacks,
        and None or NaN in it, is left empty.

    Raises
    ------
    ValueError
        Another number of rows than frames, or a key that is no column.
    """
    if len(rows) != len(record):
        raise ValueError(f"{len(rows)} rows of steps for {len(record)} frames: give one a frame")
    header = [*STEP_COLUMNS, *_stages(rows), TOTAL]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for i, row in enumerate(rows):
        full = {
            **row,
            "timestamp": f"{record.times[i]:.9f}",
            "status": record.status[i],
            "best_place": record.best_place[i],
            "kidnapped": record.kidnapped[i],
            TOTAL: record.step_ms[i],
        }
        writer.writerow([_cell(full.get(column)) for column in header])
    return out.getvalue()


def read_steps(path: Path) -> Steps:
    """Read the columns of a ``steps.csv`` that the figures need.

    Raises
    ------
    ResultsError
        Missing file or column, a row cut short, a value of the wrong kind; every fault, with file and line.
    """
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            table = list(csv.reader(stream))
    except FileNotFoundError:
        raise ResultsError(f"{path}: no such file; the run did not finish: run again") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ResultsError(f"{path}: cannot be read ({error}); check permissions, or run again") from error
    header = table[0] if table else []
    missing = [column for column in _FROM_RECORD if column not in header]
    if missing:
        raise ResultsError(f"{path}: column {', '.join(missing)} is missing; run again")
    faults: list[str] = []
    values = {column: list(_column(path, table, column, faults)) for column in _FROM_RECORD}
    if faults:
        raise ResultsError(faults)
    covariances = None
    if all(column in header for column in COVARIANCE):
        xx, xy, xt, yy, yt, tt = (
            np.array(list(_column(path, table, column, faults)), dtype=np.float64) for column in COVARIANCE
        )
        covariances = np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=1).reshape(-1, 3, 3)
    if faults:
        raise ResultsError(faults)
    return Steps(
        covariances=covariances,
        times=np.array(values["timestamp"], dtype=np.float64),
        status=tuple(values["status"]),
        best_place=np.array(values["best_place"], dtype=np.int64),
        step_ms=np.array(values[TOTAL], dtype=np.float64),
        kidnapped=np.array(values["kidnapped"], dtype=np.bool_),
    )


def read_figures(path: Path) -> dict[str, FloatArray]:
    """All columns of a ``steps.csv`` that hold numbers, by name, float64 (n,); NaN where a cell is empty.

    Raises
    ------
    ResultsError
        As `read_steps`.
    """
    read_steps(path)
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    named = [name for name in header if name not in ("status", "message")]
    try:
        return {name: np.array([float(row[header.index(name)] or "nan") for row in rows]) for name in named}
    except (ValueError, IndexError) as error:
        raise ResultsError(f"{path}: a cell holds no number ({error}); run again") from error


def read_messages(path: Path) -> tuple[str, ...]:
    """What each row of a ``steps.csv`` says was wrong with its image; empty where nothing was."""
    with path.open(encoding="utf-8", newline="") as stream:
        return tuple(row.get("message") or "" for row in csv.DictReader(stream))


def _stages(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    stages: dict[str, None] = {}
    for i, row in enumerate(rows):
        for key in row:
            if key.startswith(STAGE_PREFIX) and key != TOTAL:
                stages.setdefault(key)
            elif key not in STEP_COLUMNS and key != TOTAL:
                raise ValueError(f"row {i} of the steps: unknown column '{key}'; use {', '.join(STEP_COLUMNS)} or ms_<stage>")
    return list(stages)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    if isinstance(value, float | np.floating):
        # repr gives back the same number when read; an empty cell is "does not apply".
        return repr(float(value)) if math.isfinite(value) else ""
    # A message must not break its row, not even for readers that know nothing of quotes.
    return " ".join(str(value).split())


def _column(path: Path, table: list[list[str]], column: str, faults: list[str]) -> Iterator[Any]:
    index = table[0].index(column)
    for number, row in enumerate(table[1:], start=2):
        text = row[index] if len(row) == len(table[0]) else None
        try:
            yield _PARSERS[column](text)
        except (TypeError, ValueError):
            shown = "the row is cut short" if text is None else f"{column} = '{text}' cannot be read"
            line = f"{path}:{number}: {shown}; run again"
            if line not in faults:
                faults.append(line)


def _text(cell: str | None) -> str:
    if cell is None:
        raise TypeError
    return cell


def _float(cell: str | None) -> float:
    return float(_text(cell))


def _int(cell: str | None) -> int:
    return int(_text(cell))


def _flag(cell: str | None) -> bool:
    if _text(cell) not in ("0", "1"):
        raise ValueError
    return cell == "1"


def _or_nan(cell: str | None) -> float:
    return float(_text(cell) or "nan")


_PARSERS = {
    "timestamp": _float,
    "status": _text,
    "best_place": _int,
    "kidnapped": _flag,
    TOTAL: _or_nan,
    **dict.fromkeys(COVARIANCE, _or_nan),
}

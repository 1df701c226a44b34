"""Reading a results folder back into records."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import DatasetError, ResultsError
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.settings.validation import read_yaml
from panoloc_mcl.tools.datasets.trajectory import Trajectory, read_tum
from panoloc_mcl.tools.evaluation.definitions import ROUNDING_S
from panoloc_mcl.tools.evaluation.record import SequenceRecord
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.report.results.steps import read_steps

_RUN_FOLDER = re.compile(r"run_(\d+)")


@dataclass(frozen=True, eq=False)
class Results:
    """A results folder, read.

    Attributes
    ----------
    path : Path
        The folder itself, ``latest`` followed.
    config : mapping or None
        ``config.yaml``; None where there is none.
    run_info : mapping
        ``run.json``.
    metrics : mapping
        ``metrics.json`` as the run left it.
    records : tuple of SequenceRecord
        By name and run.
    place_positions : ndarray of float64, shape (P, 2)
        Map frame, metres.
    place_files : tuple of str, length P
    """

    path: Path
    config: Mapping[str, Any] | None
    run_info: Mapping[str, Any]
    metrics: Mapping[str, Any]
    records: tuple[SequenceRecord, ...]
    place_positions: FloatArray
    place_files: tuple[str, ...]


def read_results(path: Path) -> Results:
    """Read a results folder.

    Parameters
    ----------
    path : Path
        The folder, or ``latest``.

    Raises
    ------
    ResultsError
        Not a results folder, one of a run that did not finish, one of a newer version of the program, or damaged files.
    """
    folder = _resolved(Path(path))
    _check_whole(folder)
    run_info = _read_json(folder / layout.RUN_INFO)
    _check_version(folder / layout.RUN_INFO, "format", run_info, layout.RESULTS_FORMAT, layout.RESULTS_VERSION)
    metrics = _read_json(folder / layout.METRICS)
    _check_version(folder / layout.METRICS, "schema", metrics, layout.METRICS_FORMAT, layout.METRICS_VERSION)
    files, positions = _read_places(folder / layout.PLACES)
    config = folder / layout.CONFIG
    return Results(
        path=folder,
        config=read_yaml(config) if config.exists() else None,
        run_info=run_info,
        metrics=metrics,
        records=tuple(read_run(run, name, number) for name, number, run in _run_folders(folder)),
        place_positions=positions,
        place_files=files,
    )


def read_run(folder: Path, name: str, run: int) -> SequenceRecord:
    """Read the folder of one run over one sequence.

    Raises
    ------
    ResultsError
        Files that are missing, damaged, or do not belong together.
    """
    steps = read_steps(folder / layout.STEPS)
    trajectory = _read_tum(folder / layout.TRAJECTORY)
    _check_stamps(folder / layout.TRAJECTORY, trajectory, steps.times)
    truth = None
    if (folder / layout.GROUND_TRUTH).exists():
        truth = _truth(folder / layout.GROUND_TRUTH, steps.times)
    try:
        return SequenceRecord(
            name=name,
            run=run,
            times=trajectory.times,
            poses=trajectory.poses,
            truth=truth,
            status=steps.status,
            best_place=steps.best_place,
            step_ms=steps.step_ms,
            kidnapped=steps.kidnapped,
            covariances=steps.covariances,
        )
    except ResultsError as error:
        raise ResultsError(f"{folder}: {fault}" for fault in error.faults) from error


def _resolved(path: Path) -> Path:
    if path.is_file() and path.name == layout.LATEST:
        # Where links are not possible, latest is a text file with the folder's name.
        path = path.parent / path.read_text(encoding="utf-8").strip()
    if path.is_file():
        raise ResultsError(f"{path}: is a file; name the results folder, such as {path.parent}")
    if not path.is_dir():
        raise ResultsError(f"{path}: no such folder; name a results folder, or make one with 'panoloc run'")
    return path.resolve()


def _check_whole(folder: Path) -> None:
    missing = [name for name in (layout.RUN_INFO, layout.PLACES, layout.METRICS) if not (folder / name).exists()]
    runs = _run_folders(folder)
    if not missing and runs:
        return
    latest = folder / layout.LATEST
    if latest.exists():
        raise ResultsError(f"{folder}: holds several runs; name one of them, or {latest}")
    if not runs and layout.RUN_INFO in missing:
        raise ResultsError(f"{folder}: is not a results folder; name one that 'panoloc run' wrote")
    lacking = ", ".join([*missing, *([] if runs else ["the folders of the sequences"])])
    raise ResultsError(f"{folder}: the run did not finish ({lacking} missing); run again, or name another results folder")


def _run_folders(folder: Path) -> list[tuple[str, int, Path]]:
    found = []
    for path in folder.glob("*/run_*"):
        match = _RUN_FOLDER.fullmatch(path.name)
        if match and path.is_dir():
            found.append((path.parent.name, int(match[1]), path))
    return sorted(found)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path}: cannot be read ({error}); check permissions") from error
    except json.JSONDecodeError as error:
        raise ResultsError(f"{path}:{error.lineno}: not valid JSON ({error.msg}); run again") from error
    if not isinstance(data, dict):
        raise ResultsError(f"{path}: holds a {type(data).__name__} where an object is needed; run again")
    return data


def _check_version(path: Path, key: str, data: Mapping[str, Any], name: str, version: int) -> None:
    text = str(data.get(key))
    found, _, number = text.partition("/")
    if found != name or not number.isdecimal():
        raise ResultsError(f"{path}: {key} = '{text}', must be '{name}/{version}'; name a results folder of 'panoloc run'")
    if int(number) > version:
        raise ResultsError(f"{path}: {key} = '{text}' is newer than '{name}/{version}'; upgrade panoloc-mcl")


def _read_places(path: Path) -> tuple[tuple[str, ...], FloatArray]:
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            table = list(csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ResultsError(f"{path}: cannot be read ({error}); check permissions, or run again") from error
    if not table or tuple(table[0]) != layout.PLACES_HEADER:
        raise ResultsError(f"{path}: the first line must be '{','.join(layout.PLACES_HEADER)}'; run again")
    files, positions = [], np.zeros((len(table) - 1, 2))
    for i, row in enumerate(table[1:]):
        try:
            index, file, x, y = row
            if int(index) != i:
                raise ValueError
            positions[i] = float(x), float(y)
        except ValueError:
            shown = ",".join(row)
            raise ResultsError(f"{path}:{i + 2}: '{shown}', must be {i} and a file, x, y; run again") from None
        files.append(file)
    return tuple(files), positions


def _read_tum(path: Path) -> Trajectory:
    try:
        return read_tum(path)
    except DatasetError as error:
        raise ResultsError(error.faults) from error


def _truth(path: Path, times: FloatArray) -> FloatArray:
    """True poses of the frames (n, 3): not a number where a frame has none."""
    truth = _read_tum(path)
    rows = np.searchsorted(times, truth.times - ROUNDING_S)
    if rows[-1] >= len(times):
        raise ResultsError(f"{path}: its last pose, of {truth.times[-1]:.9f}, belongs to no row of {layout.STEPS}; run again")
    _check_stamps(path, truth, times[rows])
    poses = np.full((len(times), 3), np.nan)
    poses[rows] = truth.poses
    return poses


def _check_stamps(path: Path, trajectory: Trajectory, times: FloatArray) -> None:
    if len(trajectory.times) != len(times):
        raise ResultsError(f"{path}: {len(trajectory.times)} poses for {len(times)} rows of {layout.STEPS}; run again")
    wrong = np.flatnonzero(np.abs(trajectory.times - times) > ROUNDING_S)
    if len(wrong):
        row = int(wrong[0])
        raise ResultsError(
            f"{path}: pose {row} is of {trajectory.times[row]:.9f}, row {row} of {layout.STEPS} of {times[row]:.9f}; run again"
        )

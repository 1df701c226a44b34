"""Writing a results folder: every file whole or not at all, ``metrics.json`` last, then ``latest``."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from panoloc_mcl.robot.errors import OutputError, ResultsError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.datasets.trajectory import Trajectory, write_tum
from panoloc_mcl.tools.evaluation.record import SequenceRecord
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.report.results.results_reader import read_run
from panoloc_mcl.tools.report.results.steps import steps_text

_ELSEWHERE = "choose another folder with --out, or mend permissions and free space"


class ResultsWriter:
    """Writes ``root/name/<time>/`` piece by piece.

    The order is the caller's, but for ``finish``, which comes last: it writes the summary, the report and ``metrics.json``,
    and points ``root/name/latest`` to the folder. A run that dies before leaves neither.

    Parameters
    ----------
    root : Path
        Folder of all results.
    name : str
        Of the configuration or the experiment; one folder name.
    started : datetime
        Names the folder, to the second; a second one within it gets a suffix.

    Attributes
    ----------
    path : Path
        The new folder.

    Raises
    ------
    ResultsError
        A name that is no folder name, or a root that cannot be written.
    """

    def __init__(self, root: Path, name: str, started: datetime) -> None:
        _check_folder_name(name, "name of the results")
        if name == layout.LATEST:
            raise ResultsError(f"name of the results = '{name}': this name is taken for the newest run; choose another")
        self.path = _new_folder(Path(root) / name, started.strftime(layout.TIME_FORMAT))

    def write_config(self, config: Mapping[str, Any]) -> None:
        """Write ``config.yaml``, the resolved configuration as plain data."""
        self._write(layout.CONFIG, dump_yaml(config))

    def write_run_info(self, info: Mapping[str, Any]) -> None:
        """Write ``run.json``: versions, seed, machine, threads, command and what else says how the run came about.

        The key ``format`` is added. Numbers that are not finite become null; paths and times become text.
        """
        schema = f"{layout.RESULTS_FORMAT}/{layout.RESULTS_VERSION}"
        self._write(layout.RUN_INFO, strict_json({"format": schema, **info}))

    def write_places(self, files: Sequence[str], positions: ArrayLike) -> None:
        """Write ``places.csv``: index, file and position of each place.

        Parameters
        ----------
        files : sequence of str
            Image of each place; an empty text for a place without one.
        positions : array_like of float, shape (P, 2)
            Map frame, metres.
        """
        xy = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
        if len(files) != len(xy):
            raise ValueError(f"{len(files)} files for {len(xy)} places: give one a place")
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(layout.PLACES_HEADER)
        writer.writerows(
            (i, file, repr(float(x)), repr(float(y))) for i, (file, (x, y)) in enumerate(zip(files, xy, strict=True))
        )
        self._write(layout.PLACES, out.getvalue())

    def write_run(self, record: SequenceRecord, steps: Sequence[Mapping[str, Any]]) -> SequenceRecord:
        """Write the folder of one run over one sequence.

        Parameters
        ----------
        record : SequenceRecord
        steps : sequence of mapping, one a frame
            Rows of ``steps.csv``; see ``steps_text``.

        Returns
        -------
        SequenceRecord
            The record as a reader of the folder gets it, rounded as the files are. Figures made of it are the very ones
            that a later evaluation of the folder gives.
        """
        _check_folder_name(record.name, "sequence")
        relative = layout.run_folder(record.name, record.run)
        folder = self.path / relative
        with _as_results_error():
            write_tum(folder / layout.TRAJECTORY, Trajectory(record.times, record.poses))
            known = record.has_truth
            if record.truth is not None and known.any():
                write_tum(folder / layout.GROUND_TRUTH, Trajectory(record.times[known], record.truth[known]))
        self._write(f"{relative}/{layout.STEPS}", steps_text(record, steps))
        return read_run(folder, record.name, record.run)

    def finish(self, metrics: Mapping[str, Any], *, summary: str, report: str) -> Path:
        """Write ``summary.md``, ``report.html`` and, last, ``metrics.json``; point ``latest`` here.

        Returns
        -------
        Path
            The results folder.
        """
        self._write(layout.SUMMARY, summary)
        self._write(layout.REPORT, report)
        self._write(layout.METRICS, strict_json(metrics))
        _point_latest(self.path)
        return self.path

    def _write(self, relative: str, text: str) -> None:
        with _as_results_error():
            write_atomically(self.path / relative, text)


def strict_json(data: Mapping[str, Any]) -> str:
    """JSON text that any reader accepts: no NaN or infinity (they become null), NumPy values as plain ones."""
    return json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return value.isoformat() if isinstance(value, datetime) else str(value)


def _check_folder_name(name: str, what: str) -> None:
    if not name or name.startswith(".") or any(c in "/\\" or not c.isprintable() for c in name):
        raise ResultsError(f"{what} = '{name}': is not a folder name; use letters, digits, - and _")


def _new_folder(parent: Path, stamp: str) -> Path:
    for number in itertools.count(1):
        path = parent / (stamp if number == 1 else f"{stamp}_{number}")
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            # Another run within the second; but a file where the parent should be stays in the way for ever.
            if path.exists():
                continue
            raise ResultsError(f"{parent}: is a file where a folder is needed; {_ELSEWHERE}") from None
        except OSError as error:
            raise ResultsError(f"{path}: cannot be made ({error.strerror}); {_ELSEWHERE}") from error
        return path
    raise AssertionError("unreachable")


def _point_latest(target: Path) -> None:
    """Point ``latest`` to a folder beside it: a link, or a text file with its name where links are not possible."""
    latest = target.parent / layout.LATEST
    temporary = target.parent / f".{layout.LATEST}.{target.name}.{os.getpid()}"
    try:
        try:
            temporary.symlink_to(target.name, target_is_directory=True)
        except (OSError, NotImplementedError):
            temporary.write_text(f"{target.name}\n", encoding="utf-8")
        temporary.replace(latest)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise ResultsError(
            f"{latest}: cannot be pointed to {target.name} ({error.strerror}); the results are whole, remove what is there"
        ) from error


@contextmanager
def _as_results_error() -> Iterator[None]:
    try:
        yield
    except OutputError as error:
        raise ResultsError(f"{fault}, or choose another folder with --out" for fault in error.faults) from error

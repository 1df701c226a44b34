"""The same drives in every layout that recordings come in: are the poses, and the figures, those of the original?"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.layouts import LAYOUTS
from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.robot.camera import to_mapping
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.report.sinks import Departure, Frame, NullSink
from panoloc_mcl.tools.runs.pipeline import run

# Times of the machine are no figures of the localizer.
_NOT_COMPARED = ("step_ms",)


@dataclass
class _Poses(NullSink):
    """Remembers every answer of a run: time, pose and covariance, to the last bit."""

    rows: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)
    _now: str = ""

    def begin(self, departure: Departure) -> None:
        """Another drive."""
        self._now = f"{departure.name} {departure.run}"
        self.rows[self._now] = []

    def take(self, frame: Frame) -> None:
        """Another answer."""
        estimate = frame.estimate
        self.rows[self._now].append(np.concatenate([[estimate.timestamp], estimate.pose, estimate.covariance.ravel()]))


def study(
    config: RunConfig, names: Sequence[str] = tuple(LAYOUTS), leave: Path | None = None, progress: Progress = no_progress
) -> Report:
    """Write a data set's drives in each layout and run on it.

    Parameters
    ----------
    config : RunConfig
        Its data set must be one of this package's own layout; ``sequences`` says which drives are taken.
    names : sequence of str
        Of layouts.
    leave : Path, optional
        Where what was written is left; a folder that is removed again if left out.
    progress : callable (done, total, what)

    Raises
    ------
    DatasetError
        The data set is a recording, or its drives cannot be written in a layout.
    """
    data = read_dataset(resolve_dataset(config.dataset))
    if not (data.path / "dataset.yaml").is_file():
        raise DatasetError(f"dataset = {config.dataset}: is a recording; name a data set in this package's own layout")
    drives = data.select(config.sequences)
    images = sum(len(drive) for drive in drives)
    report = Report(
        f"{len(drives)} drives of {data.name} with {images} images, written in each layout, read again and run on, seed {config.seed}. "
        "Poses: all answers with their covariances against those on the original, bit by bit. Metrics: all of metrics.json but times.",
        facts={"dataset": data.name, "drives": [drive.name for drive in drives], "images": images, "seed": config.seed},
    )
    table = report.table(
        "Layouts", ("layout", "MB", "images answered", "poses", "metrics", "position median, mm", "heading median, deg")
    )
    with tempfile.TemporaryDirectory(prefix="panoloc-layouts-") as scratch:
        folder = leave or Path(scratch)
        original = _run(config, config.dataset, folder / "results")
        for number, name in enumerate(["original", *names]):
            progress(number, len(names) + 1, name)
            if name == "original":
                table.add(name, *_row(original, original, sum(_bytes(drive.path) for drive in drives)))
                continue
            written = _written(data, [drive.name for drive in drives], name, folder / name)
            table.add(name, *_row(_run(config, str(written), folder / "results"), original, _bytes(written / "sequences")))
            if leave is None:
                shutil.rmtree(written)
        progress(len(names) + 1, len(names) + 1, "layouts")
    return report


Found = tuple[Mapping[str, list[NDArray[np.float64]]], Mapping[str, Any]]


def _run(config: RunConfig, dataset: str, out: Path) -> Found:
    poses = _Poses()
    outcome = run(config.model_copy(update={"dataset": dataset, "out": out}), sinks=[poses])
    return poses.rows, outcome.metrics


def _written(data: Dataset, drives: list[str], layout: str, folder: Path) -> Path:
    """A copy of a data set whose drives are in another layout."""
    shutil.copytree(data.path, folder, ignore=shutil.ignore_patterns("sequences"))
    (folder / "sequences").mkdir()
    for name in drives:
        drive = data.sequences[name]
        LAYOUTS[layout].write(drive, folder / "sequences" / name)
        if drive.camera != data.camera:
            write_atomically(folder / "sequences" / f"{name}.camera.yaml", dump_yaml(to_mapping(drive.camera)))
    return folder


def _bytes(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _row(found: Found, original: Found, size: int) -> Iterator[Any]:
    (rows, metrics), (theirs, wanted) = found, original
    yield Number(size / 1e6, 1)
    yield sum(len(answers) for answers in rows.values())
    yield _difference(rows, theirs)
    unequal = sorted({path.rpartition(".")[2] for path in _unequal(metrics, wanted)})
    yield "equal" if not unequal else f"differ: {', '.join(unequal)}"
    overall = metrics["overall"]
    yield Number(_scaled(overall["position_median_m"], 1e3), 3)
    yield Number(overall["heading_median_deg"], 4)


def _scaled(value: float | None, by: float) -> float | None:
    return None if value is None else value * by


def _difference(rows: Mapping[str, list[NDArray[np.float64]]], theirs: Mapping[str, list[NDArray[np.float64]]]) -> str:
    if {name: len(answers) for name, answers in rows.items()} != {name: len(answers) for name, answers in theirs.items()}:
        return "other answers"
    mine, wanted = (np.concatenate([np.array(answers).reshape(-1, 13) for answers in some.values()]) for some in (rows, theirs))
    if mine.tobytes() == wanted.tobytes():
        return "identical"
    apart = np.hypot(*(mine - wanted)[:, 1:3].T)
    turned = np.degrees(np.abs(angle_difference(mine[:, 3], wanted[:, 3])))
    return f"{1e3 * np.median(apart):.2f} mm, {np.median(turned):.3f} deg apart (at most {1e3 * apart.max():.1f}, {turned.max():.2f})"


def _unequal(mine: Any, wanted: Any, path: str = "") -> Iterator[str]:
    """Where two trees of figures differ."""
    if isinstance(mine, Mapping) and isinstance(wanted, Mapping):
        for key in dict.fromkeys([*mine, *wanted]):
            if key not in _NOT_COMPARED:
                yield from _unequal(mine.get(key), wanted.get(key), f"{path}.{key}")
    elif mine != wanted and not (_is_nan(mine) and _is_nan(wanted)):
        yield path


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)

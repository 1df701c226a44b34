"""What a cell of a comparison gave, kept in a file and read back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.observation import VoteField
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.evaluation.definitions import STATUSES
from panoloc_mcl.tools.report.sinks import Departure, Frame, NullSink

FORMAT = "panoloc-cell/4"
# Of a record, in the file of a cell; besides them status and truth.
_ARRAYS = ("times", "poses", "best_place", "step_ms", "kidnapped")


@dataclass(frozen=True, eq=False)
class Answers:
    """What single images said: a row for each of a record.

    Parameters
    ----------
    poses : float64 (n, 3)
        The base's pose that the image gives by itself, nothing known; NaN where it says nothing.
    confidence : float64 (n,)
        Probability that it is right; NaN where the model does not know.
    guesses : float64 (n, 3)
        The best guess, of images that fit nowhere, too (`Estimate.best_guess`); NaN where there is none at all.
    """

    poses: FloatArray
    confidence: FloatArray
    guesses: FloatArray

    def of(self, rows: NDArray[np.bool_]) -> Answers:
        """Some of the images."""
        return Answers(self.poses[rows], self.confidence[rows], self.guesses[rows])


@dataclass(frozen=True)
class MapCost:
    """What a map costs.

    Parameters
    ----------
    seconds : float
        Of the processor, to build it; NaN where it was built before anybody counted.
    megabytes : float
        Of its file.
    """

    seconds: float
    megabytes: float


@dataclass(frozen=True, eq=False)
class Runs:
    """What a cell gave.

    Parameters
    ----------
    records : tuple of SequenceRecord
        One a sequence.
    places : float64 (P, 2)
        Positions of the references; ``best_place`` of the records counts in them.
    answers : tuple of Answers
        One a record; none of runs that were read from a results folder.
    cost : MapCost, optional
        Where single images were looked at.
    """

    records: tuple[SequenceRecord, ...]
    places: FloatArray
    answers: tuple[Answers, ...] = ()
    cost: MapCost | None = None


@dataclass(frozen=True)
class Failure:
    """A cell that could not be run.

    Parameters
    ----------
    text : str
        Why, in one line.
    unfit : bool
        It is the worker that lacks something, not the cell that is wrong.
    """

    text: str
    unfit: bool = False


class Overheard(NullSink):
    """Listens to runs: what every image said before the filter had its say."""

    def __init__(self) -> None:
        self.answers: list[Answers] = []
        self._rows: list[tuple[FloatArray, float, FloatArray]] = []

    def begin(self, departure: Departure) -> None:
        """A run begins."""
        self._rows = []

    def take(self, frame: Frame) -> None:
        """An answer."""
        field = frame.estimate.vote_field
        pose, confidence = (np.full(3, np.nan), np.nan) if field is None else (pose_said(field), field.confidence)
        # An image tells where the camera is; records are of the base.
        pose = frame.unwrapper.camera.mounting.base_poses(pose)
        guess = frame.estimate.best_guess
        self._rows.append((pose, confidence, np.full(3, np.nan) if guess is None else guess.pose))

    def end(self, record: SequenceRecord) -> None:
        """A run is over."""
        self.answers.append(Answers(*(np.array(part, dtype=np.float64) for part in zip(*self._rows, strict=True))))


def pose_said(field: VoteField) -> FloatArray:
    """The pose that an image gives by itself: the measured one, or else the best cell's; NaN where it says nothing."""
    if not field.informative:
        return np.full(3, np.nan)
    if field.measurement is not None:
        return field.measurement.pose
    return np.array([*field.places.positions[field.peak.place], field.peak.heading])


def write_runs(path: Path, key: str, axes: dict[str, Any], runs: Runs) -> None:
    """Keep what a cell gave, whole or not at all.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    arrays: dict[str, NDArray[Any]] = {"places": runs.places}
    for index, record in enumerate(runs.records):
        arrays |= {f"{index}.{name}": getattr(record, name) for name in _ARRAYS}
        arrays[f"{index}.status"] = np.array([STATUSES.index(status) for status in record.status], dtype=np.int8)
        if record.truth is not None:
            arrays[f"{index}.truth"] = record.truth
        if record.covariances is not None:
            arrays[f"{index}.covariances"] = record.covariances
    for index, answers in enumerate(runs.answers):
        arrays |= {f"{index}.answers.{name}": value for name, value in vars(answers).items()}
    if runs.cost is not None:
        arrays["cost"] = np.array([runs.cost.seconds, runs.cost.megabytes])
    names = [record.name for record in runs.records]
    write_arrays(path, {"format": FORMAT, "key": key, "cell": axes, "sequences": names}, arrays)


def read_runs(path: Path, key: str) -> Runs:
    """Read what a cell gave.

    Raises
    ------
    ResultsError
        Missing, cut short, or of another cell: to be run again.
    """
    try:
        header, arrays = read_arrays(path)
        if header.get("format") != FORMAT or header.get("key") != key:
            raise ValueError(f"is cell {header.get('key')}")
        records, answers = [], []
        for index, name in enumerate(header["sequences"]):
            own: dict[str, Any] = {entry: arrays[f"{index}.{entry}"] for entry in _ARRAYS}
            status = tuple(STATUSES[int(code)] for code in arrays[f"{index}.status"])
            records.append(
                SequenceRecord(
                    name=name,
                    run=0,
                    status=status,
                    truth=cast(FloatArray | None, arrays.get(f"{index}.truth")),
                    covariances=cast(FloatArray | None, arrays.get(f"{index}.covariances")),
                    **own,
                )
            )
            if f"{index}.answers.poses" in arrays:
                own = {entry: arrays[f"{index}.answers.{entry}"] for entry in ("poses", "confidence", "guesses")}
                answers.append(Answers(**own))
        cost = MapCost(*map(float, arrays["cost"])) if "cost" in arrays else None
        return Runs(tuple(records), np.asarray(arrays["places"], dtype=np.float64), tuple(answers), cost)
    except (OSError, ValueError, LookupError, ResultsError) as error:
        raise ResultsError(f"{path}: cannot be used ({error}); the cell is run again") from error

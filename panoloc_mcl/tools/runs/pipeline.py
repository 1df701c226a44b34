"""One run: data set, map, localizer over every sequence, figures, results folder."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import CameraError, ConfigError, DatasetError, MapError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.conventions import drive_findings, stamp_findings
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset, truth_at
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets.references.from_drive import references_from
from panoloc_mcl.tools.datasets.splice import splice, teleports_of
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate
from panoloc_mcl.tools.report import FrameRecorder, ResultsWriter, render_report, render_summary
from panoloc_mcl.tools.report.results.steps import COVARIANCE
from panoloc_mcl.tools.report.sinks import Departure, Frame, NullSink, Scene, Sink, Sinks
from panoloc_mcl.tools.runs.info import run_info
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import answers, recorded

# Conventions are checked before a run on so many drives, by so many pairs of images each.
_DRIVES_HELD, _PAIRS_HELD = 2, 12
# Images in which floor and walls contradict each other are worth a note from more than so many, and than this share of all, on, also
# where none of them is sure of its pose, so that a localizer learns nothing from them (`robot/interface/contradictions.py`): of
# images of the rendered hall and office it is 9 and 2 %, with a camera whose centre is off by 2 pixels 90 and 49 %.
_FEW_CONTRADICT, _SHARE_CONTRADICTS = 4, 0.33


class Monitor(Protocol):
    """Is told how far a run has come."""

    def progress(self, done: int, total: int, what: str) -> None:
        """``done`` of ``total`` steps of ``what`` are over."""

    def notice(self, text: str) -> None:
        """Something that the user should read, but that stops nothing."""


class SilentMonitor:
    """Tells nobody."""

    def progress(self, done: int, total: int, what: str) -> None:
        """Ignore it."""

    def notice(self, text: str) -> None:
        """Ignore it."""


@dataclass(frozen=True, eq=False)
class Task:
    """One drive, and where on it the robot was teleported: bool (frames,)."""

    drive: Drive
    kidnapped: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a finished run gave: its figures and its folder."""

    metrics: dict[str, Any]
    folder: Path


class ProgressSink(NullSink):
    """Tells a monitor how many images are done.

    Parameters
    ----------
    monitor : Monitor
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._images: tuple[int, ...] = ()
        self._ended = 0

    def open(self, scene: Scene) -> None:
        """Find out how many there are."""
        self._images = scene.images

    def take(self, frame: Frame) -> None:
        """Count an image, and those before it that gave no answer."""
        self._tell(sum(self._images[: self._ended]) + min(frame.index + 1, self._images[self._ended] - 1))

    def end(self, record: SequenceRecord) -> None:
        """Count the images after the last answer."""
        self._ended += 1
        self._tell(sum(self._images[: self._ended]))

    def _tell(self, done: int) -> None:
        self._monitor.progress(done, sum(self._images), "images")


def run(config: RunConfig, command: Sequence[str] = (), monitor: Monitor | None = None, sinks: Sequence[Sink] = ()) -> Outcome:
    """Localize over the sequences of a data set and write a results folder.

    Parameters
    ----------
    config : RunConfig
    command : sequence of str
        The command line, to be noted in ``run.json``.
    monitor : Monitor, optional
    sinks : sequence of Sink, optional
        Who else watches.

    Raises
    ------
    PanolocError
        Anything that the user can mend; nothing half-written is left that a reader could take for whole.
    """
    monitor = monitor or SilentMonitor()
    dataset = find_dataset(config)
    tasks = make_tasks(dataset, config)
    panorama_map = find_map(dataset, config, monitor)
    model = panorama_map.observation_model(config.observation)
    for note in panorama_map.notes:
        monitor.notice(f"map: {note}")
    for task in tasks:
        check_task(task, panorama_map, config)
        for note in task.drive.notes:
            monitor.notice(f"sequence {task.drive.name}: {note}")
        if task.drive.odometry is None:
            monitor.notice(f"sequence {task.drive.name}: has no odometry, runs on images only")
    for drive in dataset.select(config.sequences)[:_DRIVES_HELD]:
        for line in stamp_findings(drive, config.localizer.motion) or drive_findings(drive, _PAIRS_HELD):
            monitor.notice(line)
    writer = ResultsWriter(config.out, config.name, datetime.now())
    info = run_info(config, dataset, command, panorama_map.keyframes)
    writer.write_config(config.model_dump(mode="json"))
    writer.write_run_info(info)
    writer.write_places(panorama_map.references.names, panorama_map.references.positions)
    sink = Sinks([FrameRecorder(writer.path), ProgressSink(monitor), *sinks])
    trips = [(task, repeat) for task in tasks for repeat in range(config.runs)]
    records = []
    try:
        images = tuple(len(task.drive) for task, _ in trips)
        sink.open(Scene(panorama_map.name, panorama_map.references, model.places, images, panorama_map.keyframes))
        for task, repeat in trips:
            record, steps, notes = localize(task, repeat, panorama_map, model, config, sink)
            for note in notes:
                monitor.notice(f"sequence {record.name}: {note}")
            records.append(writer.write_run(record, steps))
    finally:
        sink.close()
    metrics = evaluate(records, panorama_map.references.positions)
    folder = writer.finish(
        metrics,
        summary=render_summary(metrics, info),
        report=render_report(
            metrics, info, records, panorama_map.references.positions, writer.path, panorama_map.references.names
        ),
    )
    return Outcome(metrics, folder)


def make_tasks(dataset: Dataset, config: RunConfig) -> list[Task]:
    """The drives of a run: the selected sequences as they are, or spliced where the robot is kidnapped."""
    selected = dataset.select(config.sequences)
    if not selected:
        raise DatasetError(f"{dataset.path}: has no sequences to run over; add some under sequences/")
    if config.kidnap.every_frames == 0:
        return [Task(drive, np.zeros(len(drive), dtype=np.bool_)) for drive in selected]
    rng = np.random.default_rng((config.seed, zlib.crc32(b"kidnap")))
    return [Task(drive, kidnapped) for drive, kidnapped in splice(selected, config.kidnap.every_frames, rng)]


def find_dataset(config: RunConfig) -> Dataset:
    """The data set or recordings that the configuration names, with references from one of its drives if it says so."""
    path = resolve_dataset(config.dataset)
    # Recordings that do not say which camera they are of are taken to be of the map's.
    file = config.map.file
    camera = PanoramaMap.load(file).camera if file is not None and not (path / "dataset.yaml").is_file() else None
    dataset = read_dataset(path, config.recording, camera)
    if config.references is None:
        return dataset
    wanted = config.references.model_dump()
    drive = dataset.select([wanted["from"]])[0]
    return replace(dataset, references=references_from(drive, wanted["every_m"]))


def find_map(dataset: Dataset, config: RunConfig, monitor: Monitor) -> PanoramaMap:
    """The map that the configuration names, or that of the data set's references."""
    if config.map.file is not None:
        return PanoramaMap.load(config.map.file)
    if not len(dataset.references):
        raise DatasetError(
            f"{dataset.path}: holds no references; set map to a map file, or references to {{from: SEQUENCE, every_m: 0.5}}"
        )
    return cached_map(dataset, config.observation, config.seed, monitor.progress, config.map)


def check_task(task: Task, panorama_map: PanoramaMap | None, config: RunConfig) -> None:
    """Find out before the first frame what would stop the run at a later one.

    Raises
    ------
    MapError
        The map, if there is one, does not fit the drive's camera.
    ConfigError
        The start is to be known, but the drive has no ground truth.
    """
    drive = task.drive
    if panorama_map is not None:
        try:
            panorama_map.unwrapper(drive.camera, drive.image_size)
        except CameraError as error:
            whose = f"map '{panorama_map.name}': does not fit the camera of {drive.path}"
            raise MapError(f"{whose}: {fault}" for fault in error.faults) from error
    start = None if drive.groundtruth is None else truth_at(drive.groundtruth, drive.times[:1])
    if (start is None or not np.isfinite(start).all()) and config.localizer.initial in ("known_heading", "known_pose"):
        raise ConfigError(
            f"localizer.initial = {config.localizer.initial}: sequence {drive.name} has no ground truth to start from; "
            "use uniform or a mapping x, y, heading_deg"
        )


def localize(
    task: Task,
    repeat: int,
    panorama_map: PanoramaMap,
    model: ObservationModel,
    config: RunConfig,
    sink: Sink | None = None,
) -> tuple[SequenceRecord, list[dict[str, Any]], list[str]]:
    """Run the localizer over one drive, watched by a sink.

    Returns
    -------
    record : SequenceRecord
        One row a frame that was answered.
    steps : list of dict
        The rows of ``steps.csv``.
    notes : list of str
        What the user should know: images that could not be used, a mount that leans.
    """
    drive, sink = task.drive, sink or NullSink()
    truth = None if drive.groundtruth is None else truth_at(drive.groundtruth, drive.times)
    start_pose = None
    if truth is not None and np.isfinite(truth[0]).all():
        x, y, heading = truth[0].tolist()
        start_pose = (x, y, heading)
    localizer = Localizer(
        panorama_map,
        config,
        camera=drive.camera,
        image_size=drive.image_size,
        start_pose=start_pose,
        # By name, so that a sequence gives the same result whichever others are run with it.
        seed=(config.seed + repeat, zlib.crc32(drive.name.encode())),
        model=model,
    )
    unwrapper = panorama_map.unwrapper(drive.camera, drive.image_size)
    frames: list[int] = []
    estimates: list[Estimate] = []
    steps, contradicted = [], 0
    sink.begin(Departure(drive.name, repeat, *localizer.particles))
    for image, estimate in answers(localizer, recorded(drive)):
        index = image.index
        estimate = _brought_to(estimate, image.timestamp, localizer)
        shown = None if truth is None or not np.isfinite(truth[index]).all() else truth[index]
        sink.take(Frame(len(frames), index, drive.files[index], unwrapper, estimate, *localizer.particles, shown))
        frames.append(index)
        steps.append(step_row(estimate))
        measured = None if estimate.vote_field is None else estimate.vote_field.measurement
        contradicted += measured is not None and measured.unusual
        # A vote field takes a megabyte; a long drive has thousands.
        estimates.append(replace(estimate, vote_field=None))
    times = drive.times[frames]
    record = SequenceRecord(
        name=drive.name,
        run=repeat,
        times=times,
        poses=np.array([estimate.pose for estimate in estimates]),
        truth=None if truth is None else truth[frames],
        status=tuple(estimate.status.value for estimate in estimates),
        best_place=np.array([estimate.best_place for estimate in estimates]),
        step_ms=np.array([sum(estimate.stage_ms.values()) for estimate in estimates]),
        kidnapped=teleports_of(task.kidnapped, frames),
        covariances=np.array([estimate.covariance for estimate in estimates]),
    )
    sink.end(record)
    notes = []
    if localizer.images_skipped:
        notes.append(f"{localizer.images_skipped} of {len(drive)} images skipped; steps.csv says why")
    if localizer.mounting_tilt.leans:
        notes.append(
            f"{localizer.mounting_tilt}, against that of the references; every image is refined with a tilt of its own"
        )
    if contradicted > max(_FEW_CONTRADICT, _SHARE_CONTRADICTS * len(frames)):
        notes.append(
            f"in {contradicted} of {len(frames)} images floor and walls contradict each other about the pose more than in those of the "
            "map, so less is claimed: the camera may not be as it is described; panoloc calibrate looks for that"
        )
    return record, steps, notes


def _brought_to(estimate: Estimate, timestamp: float, localizer: Localizer) -> Estimate:
    """An answer as of the time of its image, which is compared with the truth of that time.

    After a late image, and one that was left out, the belief stands at another time: odometry leads from one to the other.
    """
    between = timestamp - estimate.timestamp
    if not 0.0 < abs(between) <= localizer.settings.motion.buffer_s:
        return replace(estimate, timestamp=timestamp)
    there = localizer.pose_at(timestamp)
    if there is None:
        return replace(estimate, timestamp=timestamp)
    return replace(estimate, timestamp=timestamp, pose=there.pose, covariance=there.covariance)


def step_row(estimate: Estimate) -> dict[str, Any]:
    """One row of ``steps.csv``."""
    state, best = estimate.state, estimate.clusters[0]
    votes = estimate.vote_field
    return {
        "timestamp": estimate.timestamp,
        "status": estimate.status.value,
        "message": estimate.message,
        "particles": state.particle_count,
        "n_eff": state.effective_count,
        "spread_m": best.spread_m,
        "spread_deg": best.spread_deg,
        **dict(zip(COVARIANCE, estimate.covariance[np.triu_indices(3)].tolist(), strict=True)),
        "best_place": state.best_place,
        "best_place_votes": state.best_place_votes,
        "margin": votes.peak.margin if votes is not None and votes.informative else None,
        "resampled": state.resampled,
        "injected": state.injected,
        **{f"ms_{stage}": spent for stage, spent in estimate.stage_ms.items()},
    }

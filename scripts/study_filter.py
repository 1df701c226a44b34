"""What the filter does when all goes well and when it does not: runs with many seeds over every sequence, as Markdown.

    python scripts/study_filter.py [--dataset PATH_OR_NAME] [--seeds N] [--conditions NAME ...] [--processes N]
                                   [--foreign PATH_OR_NAME] [--frames N] [--set KEY=VALUE ...]

Conditions (``--conditions all`` takes them all, in this order):

    plain              position and heading unknown
    kidnap             the same; the sequences of a group are cut and spliced, a teleport every 20 frames, odometry silent there
    foreign            every third image is one of another data set (``--foreign``)
    drop               30 % of the images, at random, never come
    noisy_odometry     odometry is disturbed in memory: each increment gets Gaussian noise of sqrt(8) times 10 % of its way and 8 %
                       of its turn, and 2 degrees a metre more drift. Recorded noise of 10 %, 8 % and 1 degree is so tripled
    late               images are delivered 0.5 s after they were taken, and every second one only after its successor
    image_only         odometry is withheld
    no_virtual_places  a map of the references alone
    kalman             the paper's tracker, start heading known
    kalman_30 ... 180  the same, start heading wrong by so many degrees
    monte_carlo_0 ... 180   the particle filter with the same starts

Vote fields do not depend on the seed, so each image is looked at once.

Every rate is over runs, kidnaps or frames, with its Wilson 95 % interval. Definitions are those of ``panoloc_mcl.tools.evaluation``.
"After convergence" is from a run's first converged frame on. A kidnap is *noticed* when "lost" or "searching" is reported at one of
its first three images. What the status is worth: a pose is *right* under 0.5 m and 10 degrees and *wrong* above 1 m or 20 degrees;
"lost" is justified when the pose is wrong, or at the first three images after a kidnap.
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
import os
import sys
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.robot.observation.field import at_headings
from panoloc_mcl.tools.cli.monitor import monitor
from panoloc_mcl.tools.config import RunConfig, config_from_mapping
from panoloc_mcl.tools.config.overrides import apply, parse_overrides
from panoloc_mcl.tools.datasets import Dataset, Trajectory, read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets.splice import group_of, splice
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate, wilson95
from panoloc_mcl.tools.evaluation.definitions import is_bad, is_good, is_within
from panoloc_mcl.tools.evaluation.events import find_events
from panoloc_mcl.tools.evaluation.tables import PAPER_TABLE_2
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import Message, answers, recorded

KIDNAP_EVERY = 20
NOTICED_WITHIN, RECOVERED_WITHIN = 3, 10
WARM_UP = 10
WITHIN_M, WITHIN_DEG = 0.25, 3.0
LATE_S = 0.5
# Of the recorded odometry, and how much larger it is to be.
WAY_NOISE, TURN_NOISE, DRIFT_DEG_M, TIMES = 0.10, 0.08, 1.0, 3.0
FOREIGN_IMAGES = 75


@dataclass(frozen=True)
class Condition:
    """What befalls the robot, and the settings it is run with."""

    kidnapped: bool = False
    foreign_every: int = 0
    dropped: float = 0.0
    odometry_noise: float = 1.0
    late_s: float = 0.0
    image_only: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)


def _started(mode: str, error_deg: float) -> Condition:
    return Condition(settings={"localizer": {"mode": mode, "initial": "known_heading", "initial_heading_error_deg": error_deg}})


WRONG_STARTS_DEG = (30, 90, 180)
CONDITIONS = {
    "plain": Condition(),
    "kidnap": Condition(kidnapped=True),
    "foreign": Condition(foreign_every=3),
    "drop": Condition(dropped=0.3),
    "noisy_odometry": Condition(odometry_noise=TIMES),
    "late": Condition(late_s=LATE_S),
    "image_only": Condition(image_only=True),
    "no_virtual_places": Condition(settings={"observation": {"votes": {"virtual_places": {"enabled": False}}}}),
    "kalman": _started("kalman_orientation", 0),
    **{f"kalman_{degrees}": _started("kalman_orientation", degrees) for degrees in WRONG_STARTS_DEG},
    **{f"monte_carlo_{degrees}": _started("monte_carlo", degrees) for degrees in (0, *WRONG_STARTS_DEG)},
}


class Remembering:
    """An observation model that looks at each image once.

    Parameters
    ----------
    model : ObservationModel
    """

    def __init__(self, model: ObservationModel) -> None:
        self.model = model
        self.name, self.places, self.gives_heading = model.name, model.places, model.gives_heading
        self.known: dict[tuple[bytes, bool], VoteField] = {}

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of one image; at given headings, read off a field that is not refined, as the model itself does."""
        key = hashlib.blake2b(panorama.pixels.tobytes(), digest_size=16).digest(), headings is None
        if key not in self.known:
            circle = None if headings is None else 2.0 * np.pi * np.arange(panorama.pixels.shape[1]) / panorama.pixels.shape[1]
            self.known[key] = self.model.observe(panorama, circle)
        known = self.known[key]
        if headings is None:
            return known
        return replace(known, votes=at_headings(known.votes, headings), headings=headings)


@dataclass(frozen=True)
class Job:
    """The drives of one group, and what to do with them."""

    dataset: Path
    group: str
    foreign: Path | None
    conditions: tuple[str, ...]
    seeds: int
    frames: int | None
    settings: Mapping[str, Any]


def main(words: Sequence[str] | None = None) -> int:
    """Print the tables; 2 if the settings or the data cannot be used."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--foreign", metavar="DATASET", help="where the images of the condition foreign come from; same camera")
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="runs over every sequence, seeds 0 to N - 1")
    parser.add_argument(
        "--conditions", nargs="+", default=["plain"], metavar="NAME", help=f"all, or of {', '.join(CONDITIONS)}"
    )
    parser.add_argument("--processes", type=int, default=1, metavar="N", help="groups of sequences at work at once")
    parser.add_argument("--frames", type=int, metavar="N", help="only the first N images of every sequence")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args(words)
    try:
        conditions = _chosen(arguments.conditions)
        _check(arguments, conditions)
        settings: dict[str, Any] = {}
        for override in parse_overrides(arguments.overrides):
            apply(settings, override)
        path = resolve_dataset(arguments.dataset)
        foreign = None if arguments.foreign is None else resolve_dataset(arguments.foreign)
        dataset = read_dataset(path)
        drives = dataset.select(_config(settings, "plain").sequences)
        if any(drive.groundtruth is None for drive in drives) or not drives:
            raise ConfigError(f"--dataset {dataset.name}: needs sequences with ground truth; use another data set")
        with monitor() as watching:
            # The maps once, before the processes ask for them.
            for condition in conditions:
                cached_map(dataset, _config(settings, condition).observation, 0, watching.progress)
            groups = dict.fromkeys(group_of(drive.name) for drive in drives)
            jobs = [Job(path, group, foreign, conditions, arguments.seeds, arguments.frames, settings) for group in groups]
            records: dict[str, list[SequenceRecord]] = defaultdict(list)
            for done, of_group in enumerate(_worked_on(jobs, arguments.processes)):
                watching.progress(done + 1, len(jobs), "groups")
                for condition, some in of_group.items():
                    records[condition] += some
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    print(f"{dataset.name}: {len(drives)} sequences, seeds 0 to {arguments.seeds - 1}\n")
    print("\n\n".join(tables({name: records[name] for name in conditions}, dataset)))
    return 0


def _chosen(names: Sequence[str]) -> tuple[str, ...]:
    if "all" in names:
        return tuple(CONDITIONS)
    unknown = [name for name in names if name not in CONDITIONS]
    if unknown:
        raise ConfigError(f"--conditions {unknown[0]}: no such condition; use all, or of {', '.join(CONDITIONS)}")
    return tuple(dict.fromkeys(names))


def _check(arguments: argparse.Namespace, conditions: Sequence[str]) -> None:
    for name in ("seeds", "processes", "frames"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise ConfigError(f"--{name} {value}: must be at least 1")
    if arguments.foreign is None and any(CONDITIONS[name].foreign_every for name in conditions):
        raise ConfigError("--conditions foreign: needs another data set's images; give --foreign PATH")


def _config(settings: Mapping[str, Any], condition: str) -> RunConfig:
    return config_from_mapping(_merged(CONDITIONS[condition].settings, settings))


def _merged(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    both = {name: _merged(one[name], other[name]) for name in one if isinstance(one[name], Mapping) and name in other}
    return {**one, **other, **both}


def _worked_on(jobs: Sequence[Job], processes: int) -> Iterator[dict[str, list[SequenceRecord]]]:
    if processes == 1 or len(jobs) == 1:
        yield from map(study, jobs)
        return
    # Fresh processes: a fork would copy the state of threads that it does not have.
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(study, jobs)


def study(job: Job) -> dict[str, list[SequenceRecord]]:
    """Records of all runs over one group, by condition."""
    dataset = read_dataset(job.dataset)
    models: dict[str, tuple[PanoramaMap, Remembering]] = {}
    images: dict[ImageSource, NDArray[Any]] = {}
    foreign = () if job.foreign is None else _foreign_files(read_dataset(job.foreign))
    out = {}
    with threadpool_limits(1):
        for name in job.conditions:
            config = _config(job.settings, name)
            key = config.observation.model_dump_json()
            if key not in models:
                panorama_map = cached_map(dataset, config.observation, 0)
                models[key] = panorama_map, Remembering(panorama_map.observation_model(config.observation))
            drives = [
                _first(drive, job.frames) for drive in dataset.select(config.sequences) if group_of(drive.name) == job.group
            ]
            out[name] = [
                run(drive, kidnapped, CONDITIONS[name], config, seed, *models[key], images, foreign)
                for seed in range(job.seeds)
                for drive, kidnapped in _trips(drives, CONDITIONS[name], seed)
            ]
    return out


def _foreign_files(dataset: Dataset) -> tuple[ImageSource, ...]:
    files = [file for drive in dataset.sequences.values() for file in drive.files]
    return tuple(files[:: max(1, len(files) // FOREIGN_IMAGES)])


def _first(drive: Drive, frames: int | None) -> Drive:
    return drive if frames is None else replace(drive, times=drive.times[:frames], files=drive.files[:frames])


def _trips(drives: list[Drive], condition: Condition, seed: int) -> list[tuple[Drive, NDArray[np.bool_]]]:
    if not condition.kidnapped:
        return [(drive, np.zeros(len(drive), dtype=np.bool_)) for drive in drives]
    return splice(drives, KIDNAP_EVERY, np.random.default_rng((seed, zlib.crc32(b"kidnap"))))


def run(
    drive: Drive,
    kidnapped: NDArray[np.bool_],
    condition: Condition,
    config: RunConfig,
    seed: int,
    panorama_map: PanoramaMap,
    model: Remembering,
    images: dict[ImageSource, NDArray[Any]],
    foreign: Sequence[ImageSource],
) -> SequenceRecord:
    """One run over one drive; the seed is that of ``panoloc run`` with as many repeats."""
    rng = np.random.default_rng((seed, zlib.crc32(drive.name.encode()), 1))
    assert drive.groundtruth is not None
    truth = drive.groundtruth.at(drive.times)
    x, y, heading = (float(value) for value in truth[0])
    localizer = Localizer(
        panorama_map,
        config,
        camera=drive.camera,
        image_size=drive.image_size,
        start_pose=(x, y, heading),
        seed=(config.seed + seed, zlib.crc32(drive.name.encode())),
        model=model,
    )
    files = list(drive.files)
    if condition.foreign_every:
        for number, index in enumerate(range(condition.foreign_every - 1, len(files), condition.foreign_every)):
            files[index] = foreign[(number + seed * len(files)) % len(foreign)]
    odometry = None if condition.image_only else drive.odometry
    if odometry is not None and condition.odometry_noise > 1.0:
        odometry = noisier(odometry, condition.odometry_noise, rng)
    answered = {}
    stream = delivered(replace(drive, files=tuple(files), odometry=odometry), condition, rng, images)
    for _, estimate in answers(localizer, stream):
        # After a late image the answer is that to the newest one, bettered.
        answered[estimate.timestamp] = estimate
    frames = np.searchsorted(drive.times, list(answered))
    carried = np.concatenate([[0], np.cumsum(kidnapped)])[frames + 1]
    return SequenceRecord(
        name=drive.name,
        run=seed,
        times=drive.times[frames],
        poses=np.array([estimate.pose for estimate in answered.values()]),
        truth=truth[frames],
        status=tuple(estimate.status.value for estimate in answered.values()),
        best_place=np.array([estimate.best_place for estimate in answered.values()]),
        step_ms=np.array([sum(estimate.stage_ms.values()) for estimate in answered.values()]),
        kidnapped=np.concatenate([[False], np.diff(carried) > 0]),
    )


def delivered(
    drive: Drive, condition: Condition, rng: np.random.Generator, images: dict[ImageSource, NDArray[Any]]
) -> Iterator[Message]:
    """Messages in the order that they arrive in; images that were read before are taken from memory."""
    count = len(drive)
    arrival = drive.times.copy()
    if condition.late_s > 0.0:
        arrival += condition.late_s
        # Every second one only after its successor.
        swapped = np.arange(0, count - 1, 2)
        arrival[swapped] = arrival[swapped + 1] + 1e-6
    kept = rng.random(count) >= condition.dropped

    def read(file: ImageSource) -> NDArray[Any]:
        if file not in images:
            images[file] = read_image(file)
        return images[file]

    return recorded(drive, arrival, kept, read)


def noisier(odometry: Trajectory, times: float, rng: np.random.Generator) -> Trajectory:
    """Odometry whose noise is so many times as large, if it was what the constants above say."""
    steps = between(odometry.poses[:-1], odometry.poses[1:])
    way, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    # Independent errors add by their squares, a drift adds up.
    more = np.sqrt(times**2 - 1.0)
    steps[:, :2] *= 1.0 + more * WAY_NOISE * rng.standard_normal((len(steps), 1))
    steps[:, 2] += more * TURN_NOISE * turn * rng.standard_normal(len(steps))
    steps[:, 2] += (times - 1.0) * np.radians(DRIFT_DEG_M) * way * rng.choice([-1.0, 1.0])
    poses = [odometry.poses[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return Trajectory(odometry.times, np.array(poses))


def tables(records: Mapping[str, Sequence[SequenceRecord]], dataset: Dataset) -> list[str]:
    """Markdown of all that was asked for."""
    out = []
    mixed = {name: some for name, some in records.items() if not CONDITIONS[name].kidnapped and not name.startswith("kalman")}
    if mixed:
        out.append(_finding_table(mixed))
    tracked = {name: some for name, some in records.items() if not CONDITIONS[name].kidnapped}
    if tracked:
        out.append(_accuracy_table(tracked))
    out += [_kidnap_table(some) for name, some in records.items() if CONDITIONS[name].kidnapped]
    out.append(_status_table(records))
    if "kalman" in records:
        out.append(_paper_table(records["kalman"], dataset))
    return out


def _finding_table(records: Mapping[str, Sequence[SequenceRecord]]) -> str:
    rows = [
        "| condition | group | global success | images to converge: median, p95 | false convergence | tracks lost | frames 'lost' |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, group, some in _parts(records):
        events = [found for found in map(find_events, some) if found is not None]
        first = [np.inf if record.first_converged is None else record.first_converged + 1.0 for record in some]
        lost = [status == "lost" for record in some for status in record.status]
        cells = [
            rate(found.succeeded for found in events),
            f"{np.median(first):.0f}, {np.percentile(first, 95, method='higher'):.0f}",
            rate(found.falsely_converged for found in events),
            str(sum(found.tracks_lost or 0 for found in events)),
            f"{sum(lost)}/{len(lost)}",
        ]
        rows.append(f"| {name} | {group} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _accuracy_table(records: Mapping[str, Sequence[SequenceRecord]]) -> str:
    rows = [
        "| condition | group | position median / p95, m | heading median / p95, degrees | frames within 0.10 m, 1° / 0.25, 2 / 0.5, 5 "
        f"/ 1, 10, % | after convergence within 0.5 m, 5° | after image {WARM_UP} within {WITHIN_M} m, {WITHIN_DEG:.0f}° |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, group, some in _parts(records):
        figures = evaluate(some, None)["overall"]
        cells = [
            _pair(figures["position_median_m"], figures["position_p95_m"], 4),
            _pair(figures["heading_median_deg"], figures["heading_p95_deg"], 3),
            " / ".join(f"{100.0 * share:.1f}" for share in figures["within"].values()),
            rate(_within(some, 0.5, 5.0, [record.first_converged for record in some])),
            rate(_within(some, WITHIN_M, WITHIN_DEG, [WARM_UP] * len(some))),
        ]
        rows.append(f"| {name} | {group} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _kidnap_table(records: Sequence[SequenceRecord]) -> str:
    rows = [
        f"| kidnaps | recovered within {RECOVERED_WITHIN} images | images: median, p95 | noticed within {NOTICED_WITHIN} | "
        "position median / p95, m | global success | false convergence |",
        "|---|---|---|---|---|---|---|",
    ]
    for _, group, some in _parts({"kidnap": records}):
        events = [found for found in map(find_events, some) if found is not None]
        taken = [np.inf if count is None else float(count) for found in events for count in found.frames_to_recover]
        noticed = [
            any(status in ("lost", "searching") for status in record.status[start : start + NOTICED_WITHIN])
            for record in some
            for start in np.flatnonzero(record.kidnapped)
        ]
        figures = evaluate(some, None)["overall"]
        cells = [
            rate(count <= RECOVERED_WITHIN for count in taken),
            f"{np.median(taken):.0f}, {np.percentile(taken, 95, method='higher'):.0f}",
            rate(noticed),
            _pair(figures["position_median_m"], figures["position_p95_m"], 4),
            rate(found.succeeded for found in events),
            rate(found.falsely_converged for found in events),
        ]
        rows.append(f"| {group} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _status_table(records: Mapping[str, Sequence[SequenceRecord]]) -> str:
    """Precision and recall of "converged" and of "lost", frame by frame."""
    rows = [
        "| condition | group | 'converged': the pose is right | right poses called 'converged' | 'lost': justified | wrong poses after "
        "convergence: 'lost' | not 'converged' |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, group, some in _parts(records):
        good, wrong, status, since_kidnap, after = (np.concatenate(parts) for parts in zip(*map(_judged, some), strict=True))
        late_enough = wrong & after
        cells = [
            rate(good[status == "converged"]),
            rate(status[good] == "converged"),
            rate((wrong | (since_kidnap < NOTICED_WITHIN))[status == "lost"]),
            rate(status[late_enough] == "lost"),
            rate(status[late_enough] != "converged"),
        ]
        rows.append(f"| {name} | {group} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _judged(record: SequenceRecord) -> tuple[NDArray[Any], ...]:
    """Of every frame: whether the pose is right, whether it is wrong, the status, images since a kidnap, whether it had converged."""
    position, heading = record.position_error_m, record.heading_error_deg
    assert position is not None
    assert heading is not None
    frames = np.arange(len(record))
    kidnaps = np.maximum.accumulate(np.where(record.kidnapped, frames, -len(frames) - NOTICED_WITHIN))
    first = len(record) if record.first_converged is None else record.first_converged
    return is_good(position, heading), is_bad(position, heading), np.array(record.status), frames - kidnaps, frames >= first


def _paper_table(records: Sequence[SequenceRecord], dataset: Dataset) -> str:
    rows = [
        "| the Kalman mode | recognised/passed, paper | here | runs that lost their track, paper | here |",
        "|---|---|---|---|---|",
    ]
    for _, group, some in _parts({"kalman": records}):
        figures = evaluate(some, dataset.references.poses[:, :2])["overall"]["recognition"]
        paper = PAPER_TABLE_2.get(group)
        events = [found for found in map(find_events, some) if found is not None]
        cells = [
            "–" if paper is None else _rate(paper.recognised, paper.passed),
            _rate(figures["recognised"], figures["passed"]),
            "–" if paper is None else _rate(paper.tracks_lost, paper.trials),
            rate((found.tracks_lost or 0) > 0 for found in events),
        ]
        rows.append(f"| {group} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _parts(records: Mapping[str, Sequence[SequenceRecord]]) -> Iterator[tuple[str, str, list[SequenceRecord]]]:
    for name, some in records.items():
        groups: dict[str, list[SequenceRecord]] = defaultdict(list)
        for record in some:
            groups[group_of(record.name)].append(record)
        for group, members in groups.items():
            yield name, group, members


def _within(records: Sequence[SequenceRecord], metres: float, degrees: float, starts: Sequence[int | None]) -> Iterator[bool]:
    for record, start in zip(records, starts, strict=True):
        position, heading = record.position_error_m, record.heading_error_deg
        if start is None or position is None or heading is None:
            continue
        yield from is_within(position[start:], heading[start:], metres, degrees)


def rate(outcomes: Iterator[bool] | Sequence[bool] | Any) -> str:
    """Percent, counts and the Wilson interval of a series of outcomes."""
    values = [bool(value) for value in outcomes]
    return _rate(sum(values), len(values))


def _rate(count: int, total: int) -> str:
    bounds = wilson95(count, total)
    if bounds is None:
        return "–"
    return f"{100.0 * count / total:.1f} % ({count}/{total}; {100.0 * bounds[0]:.1f}–{100.0 * bounds[1]:.1f})"


def _pair(median: float | None, p95: float | None, decimals: int) -> str:
    return "–" if median is None or p95 is None else f"{median:.{decimals}f} / {p95:.{decimals}f}"


if __name__ == "__main__":
    # Products this small gain nothing from threads, and processes would fight for them.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())

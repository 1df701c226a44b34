"""Maps that cannot tell, robots beyond what is mapped, and streams that go blind: is an answer ever sure and wrong?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Rate, Report
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.interface.messages import Image, Message
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets.dataset import Sequence as Drive
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import answers, recorded

Float64 = NDArray[np.float64]

#: Sure and wrong: converged, and off by more than this.
WRONG_M = 1.0
# Blind streams see so much of a drive before.
_SEEN = 1.0 / 3.0


def _two(at: Float64) -> NDArray[np.int64]:
    return np.array([0, 1])


def _two_far_apart(at: Float64) -> NDArray[np.int64]:
    return np.array([0, int(np.argmax(np.hypot(*(at - at[0]).T)))])


def _line(axis: int) -> Callable[[Float64], NDArray[np.int64]]:
    """Of all references that have (nearly) one coordinate in common, those that are most."""

    def chosen(at: Float64) -> NDArray[np.int64]:
        beside = np.abs(at[:, None, axis] - at[None, :, axis]) < 0.1
        return np.flatnonzero(beside[int(np.argmax(beside.sum(axis=1)))])

    return chosen


def _diagonal(at: Float64) -> NDArray[np.int64]:
    span = np.maximum(np.ptp(at, axis=0), 1e-9)
    off = np.abs(np.subtract(*((at - at.min(axis=0)) / span).T))
    return np.sort(np.argsort(off, kind="stable")[: max(3, len(at) // 7)])


def _half(axis: int) -> Callable[[Float64], NDArray[np.int64]]:
    return lambda at: np.sort(np.argsort(at[:, axis], kind="stable")[: len(at) // 2])


#: Which references the map has, by their positions (n, 2).
PARTS: dict[str, Callable[[Float64], NDArray[np.int64]]] = {
    "two neighbours": _two,
    "two far apart": _two_far_apart,
    "a line along x": _line(1),
    "a line along y": _line(0),
    "a diagonal": _diagonal,
    "the half of low x": _half(0),
    "the half of low y": _half(1),
}
FOREIGN = "another building"


def _nanoseconds(image: Image, last: Image) -> Image:
    return replace(image, timestamp=image.timestamp * 1e9)


def _repeated(image: Image, last: Image) -> Image:
    return replace(image, timestamp=last.timestamp)


def _frozen(image: Image, last: Image) -> Image:
    return replace(image, source=last.source)


#: What becomes of a stream's images after a third of the drive, given the last image before.
STREAMS: dict[str, Callable[[Image, Image], Image]] = {
    "stamps in nanoseconds": _nanoseconds,
    "one stamp again and again": _repeated,
    "one image again and again": _frozen,
}


def study(
    config: RunConfig, every: int = 1, drives: int | None = None, foreign: str | None = None, progress: Progress = no_progress
) -> Report:
    """Drive where the right answer is that nobody can know.

    Parameters
    ----------
    config : RunConfig
        ``dataset``, ``observation``, ``localizer``, ``map``, ``sequences``, ``seed``.
    every : int
        Use every so many images of a drive.
    drives : int, optional
        So many at most, evenly over all.
    foreign : str, optional
        Another data set: its drives in this map, and this one's drives in its map.
    progress : callable (done, total, what)
    """
    dataset = read_dataset(resolve_dataset(config.dataset))
    sequences = _some(dataset, config.sequences, every, drives)
    other = None if foreign is None else read_dataset(resolve_dataset(foreign))
    rows = [*PARTS, *STREAMS, *([FOREIGN] if other else [])]
    report = Report(
        f"Maps of a few references of `{dataset.name}`, and streams that go blind after a third of the drive: {len(sequences)} drives, "
        f"every image of {every}, seed {config.seed}. Sure and wrong: converged, and off by more than {WRONG_M:g} m. Intervals are "
        "over drives."
    )
    table = report.table("Never sure without evidence", ("what", "references", "runs", "answers", "status", "sure and wrong"))
    everything: list[tuple[str, bool]] = []
    runs = 0
    for number, row in enumerate(rows):
        wrong: list[tuple[str, bool]] = []
        statuses: Counter[str] = Counter()
        sizes: list[int] = []
        for drive, estimates, references in _row(row, dataset, other, sequences, config, every, drives):
            sizes.append(references)
            for estimate, off_m in estimates:
                statuses[estimate.status.value] += 1
                wrong.append((drive, estimate.status is Status.CONVERGED and off_m > WRONG_M))
        shares = ", ".join(f"{name} {100.0 * many / len(wrong):.0f} %" for name, many in statuses.most_common())
        counts = " and ".join(str(size) for size in dict.fromkeys(sizes))
        table.add(row, counts, len(sizes), len(wrong), shares, Rate.over(wrong))
        everything += [(f"{row} {drive}", hit) for drive, hit in wrong]
        runs += len(sizes)
        progress(number + 1, len(rows), f"doubt, {row}")
    table.add("all", "", runs, len(everything), "", Rate.over(everything))
    return report


_Run = tuple[str, Iterator[tuple[Estimate, float]], int]


def _row(
    row: str,
    dataset: Dataset,
    other: Dataset | None,
    drives: Sequence[Drive],
    config: RunConfig,
    every: int,
    most: int | None,
) -> Iterator[_Run]:
    """The runs of a row: drive, its answers with their errors, references of the map."""
    if row in PARTS:
        chosen = PARTS[row](dataset.references.poses[:, :2])
        whole = dataset.references
        files = tuple(whole.files[index] for index in chosen)
        part = replace(dataset, references=replace(whole, files=files, poses=whole.poses[chosen], sds=None))
        panorama_map = PanoramaMap.build(part, config.observation, config.seed, settings=config.map)
        yield from _runs(panorama_map, drives, config, None)
        return
    panorama_map = cached_map(dataset, config.observation, config.seed, no_progress, config.map)
    if row in STREAMS:
        yield from _runs(panorama_map, drives, config, STREAMS[row])
        return
    assert other is not None
    yield from _runs(panorama_map, _some(other, "all", every, most), config, None, elsewhere=True)
    theirs = cached_map(other, config.observation, config.seed, no_progress, config.map)
    yield from _runs(theirs, drives, config, None, elsewhere=True)


def _runs(
    panorama_map: PanoramaMap,
    drives: Sequence[Drive],
    config: RunConfig,
    spoil: Callable[[Image, Image], Image] | None,
    elsewhere: bool = False,
) -> Iterator[_Run]:
    model = panorama_map.observation_model(config.observation)
    for drive in drives:
        yield drive.name, _answers(panorama_map, model, drive, config, spoil, elsewhere), len(panorama_map.references)


def _answers(
    panorama_map: PanoramaMap,
    model: ObservationModel,
    drive: Drive,
    config: RunConfig,
    spoil: Callable[[Image, Image], Image] | None,
    elsewhere: bool,
) -> Iterator[tuple[Estimate, float]]:
    """Answers with their errors, metres: infinite in another building; those of a blind stream count once it is blind."""
    assert drive.groundtruth is not None
    truth = drive.groundtruth.at(drive.times)
    localizer = Localizer(
        panorama_map,
        LocalizerConfig(observation=config.observation, localizer=config.localizer, seed=config.seed),
        camera=drive.camera,
        image_size=drive.image_size,
        model=model,
    )
    blind_from = int(_SEEN * len(drive)) if spoil else 0
    for image, estimate in answers(localizer, _spoilt(drive, spoil, blind_from)):
        if image.index >= blind_from:
            yield estimate, np.inf if elsewhere else float(np.hypot(*(estimate.pose[:2] - truth[image.index, :2])))


def _spoilt(drive: Drive, spoil: Callable[[Image, Image], Image] | None, begin: int) -> Iterator[Message]:
    last: Image | None = None
    for message in recorded(drive):
        if not isinstance(message, Image) or spoil is None:
            yield message
        elif message.index < begin or last is None:
            last = message
            yield message
        else:
            yield spoil(message, last)


def _some(dataset: Dataset, names: str | Sequence[str], every: int, most: int | None) -> list[Drive]:
    """Drives with ground truth among those selected, so many at most, evenly over all.

    Raises
    ------
    ConfigError
        There is none.
    """
    drives = [drive for drive in dataset.select(names) if drive.groundtruth is not None]
    if not drives:
        raise ConfigError(f"{dataset.path}: has no sequence with ground truth among those selected; use another data set")
    if most is not None and most < len(drives):
        drives = [drives[index] for index in np.linspace(0, len(drives) - 1, most).round().astype(int)]
    return [drive.of(np.arange(0, len(drive), every)) for drive in drives]

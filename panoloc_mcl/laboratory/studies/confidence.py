"""Whether a map's confidence is calibrated, and whether images of elsewhere are recognised as such."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from multiprocessing import get_context

import numpy as np
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.reports import Number, Rate, Report
from panoloc_mcl.laboratory.studies.single_images import Verdict, Viewer, counted, frames_of
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.observation.calibration import right_within
from panoloc_mcl.robot.observation.regression import expected_calibration_error, log_loss
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map

FOREIGN = "foreign"

#: Drive, confidence, whether the pose was right, whether the image was said to fit nowhere.
Judgement = tuple[str, float, bool, bool]


def study(
    config: RunConfig,
    conditions: Sequence[str],
    foreign: str | None = None,
    every: int = 1,
    processes: int = 1,
    progress: Progress = no_progress,
) -> Report:
    """Hold the confidence that the best pose is within 0.25 m against the truth, image by image.

    Parameters
    ----------
    config : RunConfig
        ``dataset``, ``observation``, ``sequences``.
    conditions : sequence of str
        Corruptions, or ``clean``.
    foreign : str, optional
        Another data set, whose images must be called ones that fit nowhere.
    every : int
        Use every so many images.
    processes : int
        Conditions at work at once.
    progress : callable (done, total, what)

    Raises
    ------
    ConfigError
        A model that learns no confidence.
    """
    for condition in conditions:
        parse_recipe(condition)
    dataset = read_dataset(resolve_dataset(config.dataset))
    model = cached_map(dataset, config.observation, config.seed, progress, config.map).observation_model(config.observation)
    calibration = model.calibration if isinstance(model, VotesModel) else None
    if calibration is None:
        raise ConfigError("observation.votes.calibration_references: this map learns no confidence; see CONFIGURATION.md")
    every_condition = [*conditions, *([FOREIGN] if foreign else [])]
    work = partial(judged, config, foreign, every)
    found: dict[str, list[Judgement]] = {}
    if processes > 1:
        with get_context("spawn").Pool(processes) as pool:
            found = dict(zip(every_condition, pool.map(work, every_condition, chunksize=1), strict=True))
    else:
        for done, condition in enumerate(every_condition):
            found[condition] = work(condition)
            progress(done + 1, len(every_condition), "conditions")
    report = Report(
        f"Map of `{dataset.name}`, calibrated on {calibration.images} images of held-out references (tolerance "
        f"{calibration.tolerance:.3f}; held-out ECE {calibration.ece:.3f}, log-loss {calibration.log_loss:.3f} nats). "
        f"{counted(frames_of(dataset, every, config.sequences))} a condition; intervals are over drives."
    )
    table = report.table(
        "", ("images", "drives", "n", "right", "mean confidence", "ECE", "log-loss, nats", "fit nowhere (95 %)")
    )
    true = [row for condition, rows in found.items() if condition != FOREIGN for row in rows]
    for label, rows in [*found.items(), ("all but foreign", true)]:
        confidence = np.array([row[1] for row in rows])
        right = np.array([row[2] for row in rows], dtype=bool)
        nowhere = Rate.over((row[0], row[3]) for row in rows)
        within = Rate.over((row[0], row[2]) for row in rows)
        scores = (confidence.mean(), expected_calibration_error(confidence, right), log_loss(confidence, right))
        table.add(label, nowhere.drives, len(rows), within, *(Number(float(score), 3) for score in scores), nowhere)
    return report


def judged(config: RunConfig, foreign: str | None, every: int, condition: str) -> list[Judgement]:
    """All images of a condition."""
    dataset = read_dataset(resolve_dataset(config.dataset))
    panorama_map = cached_map(dataset, config.observation, config.seed, settings=config.map)
    model, viewer = panorama_map.observation_model(config.observation), Viewer(panorama_map)
    within = right_within(panorama_map.references)
    recipe = None
    frames = frames_of(dataset, every, config.sequences)
    if condition == FOREIGN and foreign is not None:
        frames = frames_of(read_dataset(resolve_dataset(foreign)), every)
    else:
        recipe = parse_recipe(condition)
    rows: list[Judgement] = []
    with threadpool_limits(1):
        for frame in (frame for some in frames.values() for frame in some):
            votes = model.observe(viewer.panorama(frame, recipe))
            error = Verdict.of(frame, votes, panorama_map.references.positions).position_m
            right = condition != FOREIGN and error <= within
            confidence = 0.0 if np.isnan(votes.confidence) else votes.confidence
            rows.append((frame.drive.name, confidence, right, bool(votes.problem)))
    return rows

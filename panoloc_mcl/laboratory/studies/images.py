"""What one image tells by itself, position and heading unknown: errors of the votes and of the refined pose, by light."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.reports import Number, Rate, Report, Spread
from panoloc_mcl.laboratory.studies.single_images import TIERS, Verdict, Viewer, counted, frames_of
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.datasets.references.thinning import thinned
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M
from panoloc_mcl.tools.runs.map_cache import cached_map


@dataclass(frozen=True)
class Observed:
    """One image: what the votes alone say, what the refined pose says, and how well the refined view agrees (NaN without one)."""

    votes: Verdict
    refined: Verdict
    agreement: float


def study(
    config: RunConfig,
    every: int = 1,
    references: str = "all",
    disturb: tuple[float, float] | None = None,
    worst: int = 0,
    progress: Progress = no_progress,
) -> Report:
    """Look at single images.

    Parameters
    ----------
    config : RunConfig
        ``dataset``, ``observation``, ``sequences``, and ``seed`` of the errors.
    every : int
        Use every so many images.
    references : str
        The part of them that the map is made of: all, checkerboard, fourth, every-2m.
    disturb : (metres, degrees), optional
        Standard deviations of Gaussian errors of the references' x, y (each) and heading.
    worst : int
        How many of the images with the largest errors are listed.
    progress : callable (done, total, what)
    """
    dataset = read_dataset(resolve_dataset(config.dataset))
    frames = frames_of(dataset, every, config.sequences)
    kept = thinned(dataset.references, references, "--references")
    used, errors = (kept, "") if disturb is None else disturbed(kept, *disturb, config.seed)
    panorama_map = cached_map(replace(dataset, references=used), config.observation, config.seed, progress, config.map)
    model, viewer = panorama_map.observation_model(config.observation), Viewer(panorama_map)
    truly = kept.poses[:, :2]
    groups: dict[str, list[Observed]] = {}
    done, total = 0, sum(map(len, frames.values()))
    with threadpool_limits(1):
        for group, some in frames.items():
            for frame in some:
                votes = model.observe(viewer.panorama(frame))
                agreement = float("nan") if votes.measurement is None else votes.measurement.agreement.cosine
                found = Observed(Verdict.of(frame, votes, truly, refined=False), Verdict.of(frame, votes, truly), agreement)
                groups.setdefault(group, []).append(found)
                done += 1
                progress(done, total, "images")
    report = Report(
        f"Single images of `{dataset.name}`, nothing known: {len(kept)} of {len(dataset.references)} references{errors}, "
        f"{len(model.places)} places, model `{model.name}`; {counted(frames)}. Intervals are over drives; passed: within "
        f"{PASS_RADIUS_M:g} m of a reference."
    )
    metres, degrees = TIERS[0]
    table = report.table(
        "",
        (
            "images of",
            "drives",
            "images",
            "position mm: median / p95 / max",
            "heading degrees: median / p95 / max",
            f"within {metres:g} m, {degrees:g} degrees (95 %)",
            "recognised / passed (95 %)",
        ),
    )
    for group, rows in groups.items():
        for label, verdicts in (("vote field", [row.votes for row in rows]), ("refined", [row.refined for row in rows])):
            table.add(
                f"{group}, {label}",
                len({verdict.drive for verdict in verdicts}),
                len(verdicts),
                Spread([1000.0 * verdict.position_m for verdict in verdicts], 1),
                Spread([verdict.heading_deg for verdict in verdicts], 3),
                Rate.over((verdict.drive, verdict.within(metres, degrees)) for verdict in verdicts),
                Rate.over((verdict.drive, verdict.nearest) for verdict in verdicts if verdict.passes),
            )
    if worst:
        columns = ("image", "vote field: mm", "degrees", "refined: mm", "degrees, refined", "agreement")
        listed = report.table(f"The {worst} images with the largest errors", columns)
        everything = sorted((row for rows in groups.values() for row in rows), key=lambda row: -row.refined.position_m)
        for row in everything[:worst]:
            cells = [
                Number(value, digits)
                for verdict in (row.votes, row.refined)
                for value, digits in ((1000.0 * verdict.position_m, 1), (verdict.heading_deg, 3))
            ]
            listed.add(row.votes.name, *cells, Number(row.agreement, 3))
    return report


def disturbed(references: References, sd_m: float, sd_deg: float, seed: int) -> tuple[References, str]:
    """The same references with Gaussian errors in their poses, and what was drawn, in words.

    Parameters
    ----------
    references : References
    sd_m : float
        Standard deviation of x and of y, metres.
    sd_deg : float
        Standard deviation of the heading, degrees.
    seed : int

    Raises
    ------
    ConfigError
        A negative one.
    """
    if min(sd_m, sd_deg) < 0.0:
        raise ConfigError(f"--disturb {100 * sd_m:g} {sd_deg:g}: must not be negative")
    errors = np.random.default_rng(seed).standard_normal(references.poses.shape) * (sd_m, sd_m, np.radians(sd_deg))
    poses = references.poses + errors
    poses[:, 2] = wrap_angle(poses[:, 2])
    x, y, heading = np.sqrt(np.mean(errors**2, axis=0))
    drawn = f"{100 * x:.1f} cm in x, {100 * y:.1f} cm in y, {np.degrees(heading):.2f} degrees rms"
    return replace(references, poses=poses), f", their poses disturbed by {drawn} (seed {seed})"

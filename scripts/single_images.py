"""What one image tells by itself, position and heading unknown: errors by group of sequences, as Markdown.

    python scripts/single_images.py [--dataset PATH_OR_NAME] [--every N] [--references all|checkerboard|fourth|every-2m]
                                    [--disturb CM DEG] [--seed SEED] [--worst N] [--set KEY=VALUE ...]

Prints the errors of the vote field's best pose, and of the pose refined by synthesis. The map can be made worse than the data set is,
in memory: from a part of the references only, and with errors in their poses.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.tools.cli.monitor import monitor
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.config.overrides import apply, parse_overrides
from panoloc_mcl.tools.datasets import Dataset, References, read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.datasets.splice import group_of
from panoloc_mcl.tools.datasets.thinning import thinned
from panoloc_mcl.tools.evaluation import wilson95
from panoloc_mcl.tools.runs.map_cache import cached_map

Float64 = NDArray[np.float64]

WITHIN_M, WITHIN_DEG = 0.25, 3.0
# An image taken this near to a reference passes its place.
PASS_WITHIN_M = 0.15
_READ_OUTS = ("vote field", "refined")


@dataclass(frozen=True)
class Observed:
    """Errors of one image.

    Parameters
    ----------
    name : str
        Sequence and file.
    position_m, heading_deg : (float, float)
        Of the vote field's best pose and of the refined one; infinite where the image says nothing.
    recognised : (bool, bool), or None
        Whether the place that each names is the one passed; None for an image that passes none.
    agreement : float
        Of the refined view with the image; NaN without one.
    """

    name: str
    position_m: tuple[float, float]
    heading_deg: tuple[float, float]
    recognised: tuple[bool, bool] | None
    agreement: float


def main(words: Sequence[str] | None = None) -> int:
    """Print the table; 2 if the settings or the data cannot be used."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="use every N-th image")
    parser.add_argument(
        "--references",
        default="all",
        metavar="PART",
        help="all; checkerboard: every second of a grid; fourth; every-2m: none nearer to another than 2 m (or any other distance)",
    )
    parser.add_argument(
        "--disturb",
        nargs=2,
        type=float,
        metavar=("CM", "DEG"),
        help="standard deviation of Gaussian errors of the references' x, y (each) and heading",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the errors of the poses")
    parser.add_argument(
        "--worst", type=int, default=0, metavar="N", help="also list the N images with the largest refined errors"
    )
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args(words)
    try:
        if arguments.every < 1:
            raise ConfigError(f"--every {arguments.every}: must be at least 1")
        settings: dict[str, object] = {}
        for override in parse_overrides(arguments.overrides):
            apply(settings, override)
        config = config_from_mapping(settings)
        dataset = read_dataset(resolve_dataset(arguments.dataset))
        kept = thinned(dataset.references, arguments.references, "--references")
        used, errors = kept, ""
        if arguments.disturb is not None:
            used, errors = disturbed(kept, arguments.disturb[0] / 100.0, arguments.disturb[1], arguments.seed)
        with threadpool_limits(1), monitor() as watching:
            panorama_map = cached_map(replace(dataset, references=used), config.observation, config.seed, watching.progress)
            model = panorama_map.observation_model(config.observation)
            groups: dict[str, list[Observed]] = defaultdict(list)
            drives = [(drive, drive.groundtruth) for drive in dataset.select(config.sequences) if drive.groundtruth is not None]
            if not drives:
                raise ConfigError(f"--dataset {dataset.name}: has no sequence with ground truth; use another data set")
            total, done = sum(len(drive.files[:: arguments.every]) for drive, _ in drives), 0
            for drive, truth in drives:
                unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
                for index in range(0, len(drive), arguments.every):
                    votes = model.observe(unwrap(read_image(drive.files[index])))
                    name = f"{drive.name}/{drive.files[index].name}"
                    pose = truth.at(drive.times[index])
                    groups[group_of(drive.name)].append(_observed(name, votes, pose, kept.poses[:, :2]))
                    done += 1
                    watching.progress(done, total, "images")
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    print(_title(dataset, kept, errors, model) + "\n")
    print(_table(groups), end="")
    if arguments.worst:
        print("\n" + _worst(groups, arguments.worst), end="")
    return 0


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
    """
    if min(sd_m, sd_deg, seed) < 0:
        raise ConfigError(f"--disturb {100 * sd_m:g} {sd_deg:g} --seed {seed}: must not be negative")
    errors = np.random.default_rng(seed).standard_normal(references.poses.shape) * (sd_m, sd_m, np.radians(sd_deg))
    poses = references.poses + errors
    poses[:, 2] = wrap_angle(poses[:, 2])
    x, y, heading = np.sqrt(np.mean(errors**2, axis=0))
    said = (
        f"poses of the references disturbed by {100 * x:.1f} cm in x, {100 * y:.1f} cm in y, {np.degrees(heading):.2f} degrees "
        f"rms (seed {seed})"
    )
    return replace(references, poses=poses), said


def _observed(name: str, votes: VoteField, truth: Float64, references: Float64) -> Observed:
    """Errors of an image; ``references`` (n, 2) are where they were truly taken."""
    refined = votes.best_pose if votes.measurement is None else votes.measurement.pose
    apart = np.hypot(*(references - truth[:2]).T)
    passed = apart.min() <= PASS_WITHIN_M
    position, heading, recognised = [], [], []
    for pose in (votes.best_pose, refined):
        position.append(float(np.hypot(*(pose - truth)[:2])) if votes.informative else np.inf)
        heading.append(float(np.degrees(abs(angle_difference(pose[2], truth[2])))) if votes.informative else np.inf)
        # A model of the references alone names one; others give a pose, and the reference nearest to it.
        named = votes.peak.place if votes.places.references is None else votes.places.nearest_reference(pose[:2])
        # By distance, not by index: references taken at one spot are one place.
        recognised.append(votes.informative and bool(apart[named] <= apart.min() + 1e-9))
    agreement = float("nan") if votes.measurement is None else votes.measurement.agreement.cosine
    return Observed(
        name,
        (position[0], position[1]),
        (heading[0], heading[1]),
        (recognised[0], recognised[1]) if passed else None,
        agreement,
    )


def _title(dataset: Dataset, kept: References, errors: str, model: ObservationModel) -> str:
    part = f"{len(kept)} of {len(dataset.references)} references{', ' + errors if errors else ''}"
    return (
        f"Single images of `{dataset.name}`, nothing known: {part}, {len(model.places)} places, "
        f"model `{model.name}`. Rates with Wilson 95 % intervals; passed: within {PASS_WITHIN_M:g} m of a reference."
    )


def _table(groups: dict[str, list[Observed]]) -> str:
    lines = [
        "| | images | position mm: median / p95 / max | heading degrees: median / p95 / max "
        f"| within {WITHIN_M:g} m, {WITHIN_DEG:g} degrees | recognised / passed |",
        "|---|---|---|---|---|---|",
    ]
    for group, rows in groups.items():
        for column, label in enumerate(_READ_OUTS):
            position = np.array([row.position_m[column] for row in rows])
            heading = np.array([row.heading_deg[column] for row in rows])
            hits = int(np.sum((position <= WITHIN_M) & (heading <= WITHIN_DEG)))
            passed = [row.recognised[column] for row in rows if row.recognised is not None]
            lines.append(
                f"| {group}, {label} | {len(rows)} | {_spread(1000 * position, 1)} | {_spread(heading, 3)} "
                f"| {_rate(hits, len(rows))} | {sum(passed)}/{len(passed)}: {_rate(sum(passed), len(passed))} |"
            )
    return "\n".join(lines) + "\n"


def _worst(groups: dict[str, list[Observed]], count: int) -> str:
    rows = sorted((row for rows in groups.values() for row in rows), key=lambda row: -row.position_m[1])[:count]
    lines = ["| image | vote field: mm, degrees | refined: mm, degrees | agreement |", "|---|---|---|---|"]
    for row in rows:
        field, refined = (f"{1000 * m:.1f}, {deg:.3f}" for m, deg in zip(row.position_m, row.heading_deg, strict=True))
        lines.append(f"| {row.name} | {field} | {refined} | {row.agreement:.3f} |")
    return "\n".join(lines) + "\n"


def _rate(hits: int, trials: int) -> str:
    interval = wilson95(hits, trials)
    if interval is None:
        return "–"
    return f"{100 * hits / trials:.1f} % ({100 * interval[0]:.1f} to {100 * interval[1]:.1f})"


def _spread(values: Float64, digits: int) -> str:
    # Without interpolation, which cannot stand infinite errors.
    return " / ".join(f"{np.quantile(values, share, method='inverted_cdf'):.{digits}f}" for share in (0.5, 0.95, 1.0))


if __name__ == "__main__":
    sys.exit(main())

"""How far a map's confidence is to be believed, and whether it knows images of elsewhere: as Markdown.

    python scripts/study_confidence.py [--dataset PATH_OR_NAME] [--foreign PATH_OR_NAME] [--conditions NAME ...] [--every N]
                                  [--processes N] [--set KEY=VALUE ...]

Single images, nothing known, clean and corrupted. The map was calibrated on its own references alone (observation/calibration.py);
here its confidence that the best pose is within 0.25 m is held against the truth of all sequences. Images of another data set, if
one is named, must be called ones that fit nowhere, and true ones must not.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterator, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.observation.calibration import RIGHT_WITHIN_M, expected_calibration_error, log_loss
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.config.overrides import apply, parse_overrides
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.evaluation import wilson95
from panoloc_mcl.tools.runs.map_cache import cached_map

CONDITIONS = ("clean", "bars:0.7", "random_pixels:0.5", "bars:0.5+random_pixels:0.25", "spatial_light", "tilt:2", "tilt:4")
FOREIGN = "foreign"

Judgement = tuple[float, bool, bool]


def main(words: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--foreign", help="a data set whose images fit nowhere in the first one's map")
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), metavar="NAME", help="corruptions, or clean")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="use every N-th image")
    parser.add_argument("--processes", type=int, default=1, metavar="N", help="conditions at work at once")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args(words)
    try:
        settings: dict[str, object] = {}
        for override in parse_overrides(arguments.overrides):
            apply(settings, override)
        observation = config_from_mapping(settings).observation
        dataset = read_dataset(resolve_dataset(arguments.dataset))
        foreign = read_dataset(resolve_dataset(arguments.foreign)) if arguments.foreign else None
        model = cached_map(dataset, observation, 0).observation_model(observation)
        calibration = model.calibration if isinstance(model, VotesModel) else None
        if calibration is None:
            raise ConfigError("observation.votes.calibration_references: this map learns no confidence; see CONFIGURATION.md")
        conditions = [*arguments.conditions, *([FOREIGN] if foreign else [])]
        work = partial(judged, dataset, foreign, observation, every=arguments.every)
        if arguments.processes > 1:
            with get_context("spawn").Pool(arguments.processes) as pool:
                judgements = pool.map(work, conditions, chunksize=1)
        else:
            judgements = [work(condition) for condition in conditions]
        found = dict(zip(conditions, judgements, strict=True))
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    print(
        f"Map of `{dataset.name}`, calibrated on {calibration.images} images of held-out references (tolerance "
        f"{calibration.tolerance:.3f}; held-out ECE {calibration.ece:.3f}, log-loss {calibration.log_loss:.3f} nats)\n"
    )
    print("\n".join(table(found)))
    return 0


def judged(
    dataset: Dataset, foreign: Dataset | None, observation: ObservationSettings, condition: str, every: int
) -> list[Judgement]:
    """Confidence, whether it was right, and whether the image was said to fit nowhere, for every image of a condition."""
    panorama_map = cached_map(dataset, observation, 0)
    model = panorama_map.observation_model(observation)
    source = foreign if condition == FOREIGN and foreign is not None else dataset
    recipe = None if condition in ("clean", FOREIGN) else parse_recipe(condition)
    geometry = panorama_map.references.geometry
    rows: list[Judgement] = []
    with threadpool_limits(1):
        for number, (file, unwrap, truth) in enumerate(_images(source, panorama_map)):
            if number % every:
                continue
            image = np.asarray(read_image(file), dtype=np.uint8)
            if recipe is not None:
                rng = np.random.default_rng([zlib.crc32(condition.encode()), number])
                image = recipe.image(image, rng, geometry.elevation_deg)
            field = model.observe(unwrap(image))
            pose = field.best_pose if field.measurement is None else field.measurement.pose
            right = condition != FOREIGN and bool(np.hypot(*(pose - truth)[:2]) <= RIGHT_WITHIN_M)
            rows.append((0.0 if np.isnan(field.confidence) else field.confidence, right, bool(field.problem)))
    return rows


def _images(source: Dataset, panorama_map: PanoramaMap) -> Iterator[tuple[Path, Unwrapper, NDArray[np.float64]]]:
    for drive in source.sequences.values():
        if drive.groundtruth is not None:
            unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
            for time, file in zip(drive.times, drive.files, strict=True):
                yield file, unwrap, drive.groundtruth.at(time)


def table(found: dict[str, list[Judgement]]) -> list[str]:
    """Markdown lines: one for every condition, and one for all that are not foreign."""
    lines = [
        "| images | n | within 0.25 m | mean confidence | ECE | log-loss, nats | fit nowhere (95 %) |",
        "|---|---|---|---|---|---|---|",
    ]
    true = [row for condition, rows in found.items() if condition != FOREIGN for row in rows]
    for label, rows in [*found.items(), ("all but foreign", true)]:
        confidence: NDArray[np.float64] = np.array([row[0] for row in rows])
        right, nowhere = (np.array([row[part] for row in rows], dtype=bool) for part in (1, 2))
        low, high = wilson95(int(nowhere.sum()), len(rows)) or (0.0, 1.0)
        lines.append(
            f"| {label} | {len(rows)} | {100.0 * right.mean():.1f} % | {confidence.mean():.3f} "
            f"| {expected_calibration_error(confidence, right):.3f} | {log_loss(confidence, right):.3f} "
            f"| {100.0 * nowhere.mean():.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f}) |"
        )
    return lines


if __name__ == "__main__":
    sys.exit(main())

"""What one image tells by itself, position and heading unknown: errors by group of sequences, as Markdown.

    python scripts/single_images.py [--dataset PATH_OR_NAME] [--every N] [--set KEY=VALUE ...]

Prints the errors of the vote field's best pose, and of the pose refined by synthesis.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np
from threadpoolctl import threadpool_limits

from panoloc_mcl.config import config_from_mapping
from panoloc_mcl.config.overrides import apply, parse_overrides
from panoloc_mcl.datasets import read_dataset, read_image, resolve_dataset
from panoloc_mcl.datasets.splice import group_of
from panoloc_mcl.evaluation import wilson95
from panoloc_mcl.geometry import angle_difference
from panoloc_mcl.map_cache import cached_map


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="room", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--every", type=int, default=1, help="use every N-th image")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    settings: dict[str, object] = {}
    for override in parse_overrides(arguments.overrides):
        apply(settings, override)
    config = config_from_mapping(settings)
    dataset = read_dataset(resolve_dataset(arguments.dataset))
    panorama_map = cached_map(dataset, config.observation, config.seed)
    model = panorama_map.observation_model(config.observation)
    errors: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    with threadpool_limits(1):
        for drive in dataset.select(config.sequences):
            if drive.groundtruth is None:
                continue
            unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
            for time, file in list(zip(drive.times, drive.files, strict=True))[:: arguments.every]:
                votes = model.observe(unwrap(read_image(file)))
                truth = drive.groundtruth.at(time)
                refined = votes.best_pose if votes.measurement is None else votes.measurement.pose
                row = []
                for pose in (votes.best_pose, refined):
                    row += [np.hypot(*(pose - truth)[:2]), np.degrees(abs(angle_difference(pose[2], truth[2])))]
                errors[group_of(drive.name)].append(tuple(float(value) for value in row))
    print(f"Single images of `{dataset.name}`, nothing known: {len(model.places)} places, model `{model.name}`\n")
    print(
        "| | images | position mm: median / p95 / max | heading degrees: median / p95 / max | within 0.25 m, 3 degrees (95 %) |"
    )
    print("|---|---|---|---|---|")
    for group, rows in errors.items():
        table = np.array(rows)
        for label, column in (("vote field", 0), ("refined", 2)):
            position, heading = table[:, column], table[:, column + 1]
            hits = int(np.sum((position <= 0.25) & (heading <= 3.0)))
            low, high = wilson95(hits, len(rows)) or (0.0, 1.0)
            print(
                f"| {group}, {label} | {len(rows)} | {_spread(1000 * position, 1)} | {_spread(heading, 3)} "
                f"| {100 * hits / len(rows):.1f} % ({100 * low:.1f} to {100 * high:.1f}) |"
            )


def _spread(values: np.ndarray, digits: int) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in (np.median(values), np.percentile(values, 95), values.max()))


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Whether a mended map knows how far its frame is off: many surveys of one place, through the pose graph alone.

All poses of a mended map share the error of its frame, which is that of the given poses together; a survey is one draw of it, and a map
takes minutes. What images tell of relative poses hardly depends on the survey, so it is taken from one map here: each survey is the
references' true poses and Gaussian errors (those that `panoloc study consistency` draws), mended by a pose graph of its own.

Usage: frame_of_surveys.py DATASET [SURVEYS]
"""

from __future__ import annotations

import sys
import zlib

import numpy as np

from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import read_dataset
from panoloc_mcl.tools.evaluation import consistency
from panoloc_mcl.tools.runs.map_cache import cached_map

ERRORS = (("2 cm, 1°", 0.02, 1.0), ("5 cm, 2°", 0.05, 2.0))


def main() -> None:
    """Print the table."""
    dataset, config = read_dataset(sys.argv[1]), RunConfig(dataset=sys.argv[1])
    surveys = int(sys.argv[2]) if len(sys.argv) > 2 else 120
    keyframes = cached_map(dataset, config.observation, config.seed).keyframes
    # Exact in a rendered data set, whose map keeps them as they are.
    truth = keyframes.given
    print(
        "| poses off by | surveys | heading of the map: error rms | claimed | position of a keyframe: error rms | claimed | "
        "NEES, position / heading | within 2 sd, % |\n|---|---|---|---|---|---|---|---|"
    )
    for name, xy_m, theta_deg in ERRORS:
        errors, covariances = [], []
        for seed in range(surveys):
            rng = np.random.default_rng((seed, zlib.crc32(b"pose_noise")))
            given = truth + rng.standard_normal(truth.shape) * (xy_m, xy_m, np.radians(theta_deg))
            solution = solve(given, keyframes.edges, Priors(given, np.full((len(given), 2), np.nan)))
            off = solution.poses - truth
            off[:, 2] = angle_difference(solution.poses[:, 2], truth[:, 2])
            errors.append(off)
            covariances.append(solution.covariances)
        turned, claimed = np.mean(errors, axis=1)[:, 2], np.einsum("snii->sni", covariances)
        held = consistency(np.concatenate(errors), np.concatenate(covariances))
        error, said = (np.degrees(np.sqrt(np.mean(part))) for part in (turned**2, claimed[..., 2]))
        off_mm, said_mm = (1000.0 * np.sqrt(np.mean(part)) for part in (np.square(errors)[..., :2], claimed[..., :2]))
        print(
            f"| {name} | {surveys} | {error:.3f}° | {said:.3f}° | {off_mm:.1f} mm | {said_mm:.1f} mm "
            f"| {held['position']['nees_median']:.2f} / {held['heading']['nees_median']:.2f} "
            f"| {100.0 * held['position']['inside_2sd']:.0f} / {100.0 * held['heading']['inside_2sd']:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

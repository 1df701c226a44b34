"""Whether a mended map knows how far its frame is off: many surveys of one place, through the pose graph alone.

All poses of a mended map share the error of its frame, which is that of the given poses together; a survey is one draw of it, and a map
takes minutes. What images tell of relative poses hardly depends on the survey, so it is taken from one map here: each survey is the
references' true poses and Gaussian errors (those that `panoloc study consistency` draws), mended by a pose graph of its own.
"""

from __future__ import annotations

import zlib

import numpy as np

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.robot.geometry import FloatArray, angle_difference
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.evaluation import consistency
from panoloc_mcl.tools.runs.map_cache import cached_map

#: Standard deviations of the given poses: of x and of y in metres, of the heading in degrees.
ERRORS = {"2 cm, 1°": (0.02, 1.0), "5 cm, 2°": (0.05, 2.0)}
HEADS = (
    "poses off by",
    "heading of the map: error rms, °",
    "claimed, °",
    "position of a keyframe: error rms, mm",
    "claimed, mm",
    "position: NEES",
    "heading: NEES",
    "position: within 2 sd, %",
    "heading: within 2 sd, %",
)


def study(config: RunConfig, surveys: int = 120, progress: Progress = no_progress) -> Report:
    """Draw surveys, mend each, and hold errors against claims.

    Parameters
    ----------
    config : RunConfig
        Of a data set whose references stand where it says, as in a rendered one.
    surveys : int
        Of each kind of error.
    progress : callable (done, total, what)
    """
    dataset = read_dataset(resolve_dataset(config.dataset))
    keyframes = cached_map(dataset, config.observation, config.seed, settings=config.map).keyframes
    report = Report(
        f"{surveys} surveys of the {len(keyframes.given)} references of `{dataset.name}`, each mended by a pose graph."
    )
    table = report.table("", HEADS)
    for done, (name, (xy_m, theta_deg)) in enumerate(ERRORS.items(), start=1):
        errors, covariances = surveyed(keyframes, xy_m, theta_deg, surveys)
        table.add(name, *_cells(errors, covariances))
        progress(done, len(ERRORS), "kinds of error")
    return report


def surveyed(keyframes: Keyframes, xy_m: float, theta_deg: float, surveys: int) -> tuple[FloatArray, FloatArray]:
    """Errors of mended poses, and the covariances that are claimed of them.

    Parameters
    ----------
    keyframes : Keyframes
        The given poses are taken as true ones; the edges are used as they are.
    xy_m, theta_deg : float
        Standard deviations of the poses that a survey gives.
    surveys : int

    Returns
    -------
    errors : float64 (surveys, n, 3)
        Metres, metres, radians.
    covariances : float64 (surveys, n, 3, 3)
    """
    truth, nobody_says = keyframes.given, np.full((len(keyframes.given), 2), np.nan)
    errors, covariances = [], []
    for seed in range(surveys):
        rng = np.random.default_rng((seed, zlib.crc32(b"pose_noise")))
        given = truth + rng.standard_normal(truth.shape) * (xy_m, xy_m, np.radians(theta_deg))
        solution = solve(given, keyframes.edges, Priors(given, nobody_says))
        off = solution.poses - truth
        off[:, 2] = angle_difference(solution.poses[:, 2], truth[:, 2])
        errors.append(off)
        covariances.append(solution.covariances)
    return np.stack(errors), np.stack(covariances)


def _cells(errors: FloatArray, covariances: FloatArray) -> list[Number]:
    turned, claimed = errors.mean(axis=1)[:, 2], np.einsum("snii->sni", covariances)
    held = consistency(errors.reshape(-1, 3), covariances.reshape(-1, 3, 3))
    headings = [Number(float(np.degrees(np.sqrt(np.mean(part)))), 3) for part in (turned**2, claimed[..., 2])]
    positions = [Number(float(1e3 * np.sqrt(np.mean(part))), 1) for part in (errors[..., :2] ** 2, claimed[..., :2])]
    nees = [Number(held[axis]["nees_median"], 2) for axis in ("position", "heading")]
    inside = [Number(100.0 * held[axis]["inside_2sd"], 0) for axis in ("position", "heading")]
    return [*headings, *positions, *nees, *inside]

"""How far a map errs by itself: what no image can average out, learnt from references that are held out.

A pose read off an image is only as good as the references that the views were made from: their poses are off, walls are not where the
depths say, the camera's height or mounting is not what was given. References are measured against others as though they were images,
from one source or several, near and far, on one side and all around, and `SourceErrors` is what explains best how far they are off.
Because it is a function of where the sources lie, an image among near sources is claimed to be better than the held-out references
were, which lack the nearest; and that a held-out reference errs itself is counted out.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.refinement import PoseRefiner
from panoloc_mcl.robot.synthesis.source_errors import UNKNOWN, SourceErrors, shares
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Sources of trials are among so many neighbours.
_AROUND = 8
# Where a trial begins: as far off as the cells of a vote field are.
_START_SD = np.array([0.07, 0.07, np.radians(0.7)])
# A trial that ends farther off has found another place, which is a matter of confidence and not of covariance.
_ASTRAY_M, _ASTRAY = 0.3, np.radians(10.0)
# Fewer trials teach nothing.
_FEWEST_TRIALS = 10
# Degrees of freedom of the errors' distribution (Student's t): now and then one is far larger than the others.
_FREEDOM = 8.0
# Variances considered, square metres or radians, for a source at the usual distance.
_SMALLEST, _LARGEST = 1e-9, 0.1


class Trial(NamedTuple):
    """A reference measured against others.

    Parameters
    ----------
    error : float64 (3,)
        Measured pose less given one, metres and radians.
    covariance : float64 (3, 3)
        That the image claims for itself.
    shares : float64 (3,)
        See `shares`; of the reference's own pose as well.
    """

    error: Float64
    covariance: Float64
    shares: Float64


def learn_source_errors(
    synthesizer: ViewSynthesizer,
    settings: VotesSettings,
    most_references: int,
    progress: Progress = no_progress,
    threads: int = 1,
) -> SourceErrors:
    """Learn from references that are held out one by one.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
    settings : VotesSettings
    most_references : int
        So many at most are held out, evenly over all that are not alone.
    progress : callable (done, total, what)
    threads : int
        References at work at once; the result does not depend on it.

    Returns
    -------
    SourceErrors
        `UNKNOWN` where too few references have neighbours.
    """
    usable = np.flatnonzero(~synthesizer.alone)
    if len(usable) < 2 or most_references < 2:
        return UNKNOWN
    chosen = usable[np.unique(np.linspace(0, len(usable) - 1, most_references).round().astype(np.int64))]
    trials: list[Trial] = []
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for done, some in enumerate(pool.map(lambda index: list(_trials(synthesizer, settings, int(index), usable)), chosen)):
            trials += some
            progress(done + 1, len(chosen), "errors of the map")
    return explain(trials)


def _trials(synthesizer: ViewSynthesizer, settings: VotesSettings, held_out: int, usable: Int64) -> Iterator[Trial]:
    references = synthesizer.references
    truth = np.array([*references.positions[held_out], 0.0])
    rng = np.random.default_rng(held_out)
    z, seen = orientations(references.panorama(held_out), settings)
    apart = np.hypot(*(references.positions[usable] - truth[:2]).T)
    around = usable[np.argsort(apart, kind="stable")]
    around = around[around != held_out][:_AROUND]
    count = settings.refinement.sources
    for sources in (around[:count], rng.permutation(around)[:count], around[:1], around[1:2], rng.permutation(around[2:])[:1]):
        if len(sources) == 0:
            continue
        refiner = PoseRefiner(synthesizer.of(np.sort(sources)), settings)
        start = truth + _START_SD * rng.standard_normal(3)
        measured = refiner.refine(z, seen, start)
        error = measured.pose - truth
        error[2] = angle_difference(measured.pose[2], truth[2])
        if np.hypot(*error[:2]) < _ASTRAY_M and abs(error[2]) < _ASTRAY:
            of_sources = shares(*refiner.sources_at(measured.pose[:2]))
            yield Trial(error, measured.covariance, of_sources + np.array([1.0, 0.0, 0.0]))


def explain(trials: list[Trial]) -> SourceErrors:
    """The standard deviations under which the errors of trials are likeliest; `UNKNOWN` from too few of them."""
    if len(trials) < _FEWEST_TRIALS:
        return UNKNOWN
    errors = np.array([trial.error for trial in trials])
    claimed = np.array([np.diag(trial.covariance) for trial in trials])
    kinds = np.array([trial.shares for trial in trials])
    position = _likeliest(np.sum(errors[:, :2] ** 2, axis=1), 0.5 * (claimed[:, 0] + claimed[:, 1]), kinds, 2)
    heading = _likeliest(errors[:, 2] ** 2, claimed[:, 2], kinds, 1)
    of_pose, to_one_side, with_distance = np.sqrt(np.stack([position, heading], axis=1))
    return SourceErrors(of_pose, to_one_side, with_distance, len(trials))


def _likeliest(squares: Float64, claimed: Float64, kinds: Float64, dimensions: int) -> Float64:
    """Variances of the kinds of errors (k,) that explain squared errors (n,) besides what is claimed (n,)."""
    usual = np.maximum(kinds.mean(axis=0), 1e-9)

    def surprise(logarithms: Float64) -> float:
        variances = claimed + kinds @ (np.exp(logarithms) / usual)
        tail = 0.5 * (_FREEDOM + dimensions) * np.log1p(squares / variances / _FREEDOM)
        return float(np.sum(0.5 * dimensions * np.log(variances) + tail))

    bounds = [(np.log(_SMALLEST), np.log(_LARGEST))] * len(usual)
    typical = np.log(np.clip(np.median(squares) / dimensions, 10.0 * _SMALLEST, 0.1 * _LARGEST))
    # Which kind it is decides where the search begins: all, or one of them first.
    starts = [np.full(len(usual), typical), *(typical - 6.0 * (1.0 - row) for row in np.eye(len(usual)))]
    found = [minimize(surprise, np.clip(start, *bounds[0]), method="L-BFGS-B", bounds=bounds) for start in starts]
    best = min(found, key=lambda one: float(one.fun)).x
    # The scale of Student's t is not its variance.
    return np.asarray(np.exp(best) / usual * _FREEDOM / (_FREEDOM - 2.0))

"""How far a map errs by itself: what no image can average out, learnt from references that are held out.

A pose read off an image is only as good as the references that the views were made from: their poses are off, walls are not where the
depths say, the camera's height or mounting is not what was given. Part of it the image shows: the sectors of the circle pull the pose
to different sides, the more the worse the views are (see `PoseRefiner`). How far these pulls are to be believed, and what they cannot
show because it displaces all sectors alike, is learnt here: references are measured against others around them as though they were
images, near and far, on one side and all around, as they are and in other light, and `SourceErrors` is what explains best how far they
are off. Because it is a function of the image and of where the sources lie, an image among near sources is claimed to be better than
the held-out references were, which lack the nearest; and that a held-out reference errs itself is counted out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.refinement import PoseRefiner
from panoloc_mcl.robot.synthesis.source_errors import UNKNOWN, SourceErrors, shares, sharpness_of
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
_Relit = Callable[[NDArray[np.uint8], np.random.Generator], NDArray[np.uint8]]

# Sources of trials are among so many neighbours: the nearest, and this often some of them at random. Of only eight, all are about as
# far off, and errors of their poses pass for such as grow with the way to them.
_AROUND, _AT_RANDOM = 12, 1
# References held out, for each one that a calibration holds out: trials of several sources are what teaches.
_HELD_OUT = 2
# Where a trial begins: as far off as the cells of a vote field are.
_START_SD = np.array([0.07, 0.07, np.radians(0.7)])
# A trial that ends farther off has found another place, which is a matter of confidence and not of covariance.
_ASTRAY_M, _ASTRAY = 0.3, np.radians(10.0)
# Fewer trials teach nothing.
_FEWEST_TRIALS = 10
# Degrees of freedom of the errors' distribution (Student's t): now and then one is far larger than the others.
_FREEDOM = 8.0
# Squares of normal errors over their variance, in one and two dimensions: the median, and the quantile that is two standard deviations
# in two dimensions.
_SHARES, _CHI2 = (0.5, 0.8647), {1: (0.455, 2.231), 2: (1.386, 4.0)}
# Variances considered, square metres or radians, for a source at the usual distance; and factors on what the image shows.
_SMALLEST, _LARGEST = 1e-9, 0.1
_FACTORS = (0.5, 25.0)
# How far errors of several sources average out depends on how large they are, which is told by how far they average out.
_ROUNDS, _SHARPNESS = 3, 2.0
_NOTHING_KEPT = Parts()
# Bands of rows contradict each other usually by no more than so many times this quantile of the trials: images among near sources have
# less noise to hide it. Of images of the rendered hall and office that are as the map is, 9 and 2 % are beyond.
_USUAL, _TIMES = 0.95, 1.5
# Depths of the sources were swept with the held-out reference, too, and hide some of what its pose is off. Swept anew without it, its
# position was off by exp(0.11) times as much in the median, its heading by 1.3 times (rendered hall, 11 and 14 of its references off by
# 5 and 2 cm, 2 and 1 degrees): so much of the variances of position and heading.
_HIDDEN_BY_DEPTHS = np.array([1.25, 1.7])


class Trial(NamedTuple):
    """A reference measured against others.

    Parameters
    ----------
    error : float64 (3,)
        Measured pose less given one, metres and radians.
    shown : float64 (3, 3)
        Covariance that the image shows.
    weights, offsets : float64 (s,) and (s, 2)
        Of the sources, and from them to the pose, metres.
    contradiction : float
        Of the bands of rows.
    """

    error: Float64
    shown: Float64
    weights: Float64
    offsets: Float64
    contradiction: float = 1.0


def learn_source_errors(
    synthesizer: ViewSynthesizer,
    settings: VotesSettings,
    most_references: int,
    progress: Progress = no_progress,
    threads: int = 1,
    relit: _Relit | None = None,
    parts: Parts = _NOTHING_KEPT,
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
    relit : callable (image, generator), optional
        The 8-bit image in other light; None: as it is only.
    parts : Parts
        Where what is done is kept.

    Returns
    -------
    SourceErrors
        `UNKNOWN` where too few references have neighbours.
    """
    usable = np.flatnonzero(~synthesizer.alone)
    if len(usable) < 2 or most_references < 2:
        return UNKNOWN
    chosen = usable[np.unique(np.linspace(0, len(usable) - 1, _HELD_OUT * most_references).round().astype(np.int64))]

    def tried(number: int) -> Iterator[Trial]:
        return _trials(synthesizer, settings, int(chosen[number]), usable, relit)

    columns = parts.listed("errors of the map", len(chosen), 2 * threads, tried, threads, progress)
    trials = [Trial(*row) for row in zip(*columns, strict=True)]
    # An error of the heading displaces all that is seen by as much, one of the position the less the farther it is.
    pixels = synthesizer.references.geometry.width / (2.0 * np.pi)
    return explain(trials, np.array([pixels / float(np.median(synthesizer.profiles)), pixels]))


def _trials(
    synthesizer: ViewSynthesizer, settings: VotesSettings, held_out: int, usable: Int64, relit: _Relit | None
) -> Iterator[Trial]:
    references = synthesizer.references
    truth = np.array([*references.positions[held_out], 0.0])
    rng = np.random.default_rng(held_out)
    panorama = references.panorama(held_out)
    images = [orientations(panorama, settings)]
    if relit is not None:
        dimmed = relit(np.clip(np.rint(panorama.pixels), 0, 255).astype(np.uint8), rng).astype(np.float32)
        images.append(orientations(Panorama(dimmed, panorama.valid), settings))
    apart = np.hypot(*(references.positions[usable] - truth[:2]).T)
    around = usable[np.argsort(apart, kind="stable")]
    around = around[around != held_out][:_AROUND]
    count = settings.refinement.sources
    for sources in (around[:count], *(rng.permutation(around)[:count] for _ in range(_AT_RANDOM))):
        refiner = PoseRefiner(synthesizer.of(np.sort(sources)), settings)
        for z, seen in images:
            start = truth + _START_SD * rng.standard_normal(3)
            measured = refiner.refine(z, seen, start)
            error = measured.pose - truth
            error[2] = angle_difference(measured.pose[2], truth[2])
            if np.hypot(*error[:2]) < _ASTRAY_M and abs(error[2]) < _ASTRAY:
                # Without any errors of the sources, its covariance is what the image shows.
                yield Trial(error, measured.covariance, *refiner.sources_at(measured.pose[:2]), measured.contradiction)


def explain(trials: list[Trial], pixels: Float64) -> SourceErrors:
    """The errors under which those of trials are likeliest; `UNKNOWN` from too few of them.

    Parameters
    ----------
    trials : list of Trial
    pixels : float64 (2,)
        By how many pixels a metre and a radian displace what is seen.
    """
    if len(trials) < _FEWEST_TRIALS:
        return UNKNOWN
    errors = np.array([trial.error for trial in trials])
    shown = np.array([trial.shown for trial in trials])
    sharpness = _SHARPNESS
    position = heading = None
    for _ in range(_ROUNDS):
        # That of the reference itself is in its error, too.
        kinds = np.array([shares(trial.weights, trial.offsets, sharpness) for trial in trials]) + np.array([1.0, 0.0])
        position = _likeliest(errors[:, :2], shown[:, :2, :2], kinds, position)
        heading = _likeliest(errors[:, 2:], shown[:, 2:, 2:], kinds, heading)
        of_views, of_pose, to_one_side = np.stack([position, heading], axis=1)
        of_pose *= _HIDDEN_BY_DEPTHS
        sharpness = sharpness_of(float(np.sqrt(np.square(pixels) @ of_pose)))
    usual = _TIMES * float(np.quantile([trial.contradiction for trial in trials], _USUAL))
    return SourceErrors(of_views, np.sqrt(of_pose), np.sqrt(to_one_side), sharpness, len(trials), usual)


def _likeliest(errors: Float64, shown: Float64, kinds: Float64, near: Float64 | None) -> Float64:
    """Factor on what the images show, and variances of the kinds of errors (k,), that explain errors (n, d): float64 (1 + k,).

    From ``near``, where it is about known.
    """
    usual = np.maximum(kinds.mean(axis=0), 1e-9)
    dimensions = errors.shape[1]

    def explained(logarithms: Float64) -> tuple[Float64, Float64]:
        """Covariances, and squares of the errors over them."""
        factor, *variances = np.exp(logarithms)
        others = kinds @ (np.array(variances) / usual)
        covariances = factor * shown + others[:, None, None] * np.eye(dimensions)
        squares = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
        return covariances, np.asarray(squares)

    def surprise(logarithms: Float64) -> float:
        covariances, squares = explained(logarithms)
        tail = 0.5 * (_FREEDOM + dimensions) * np.log1p(squares / _FREEDOM)
        return float(np.sum(0.5 * np.linalg.slogdet(covariances)[1] + tail))

    lowest = np.log([_FACTORS[0], *[_SMALLEST] * len(usual)])
    highest = np.log([_FACTORS[1], *[_LARGEST] * len(usual)])
    scale = np.array([1.0, *usual]) * (_FREEDOM - 2.0) / _FREEDOM
    typical = np.log(np.clip(np.median(np.sum(errors**2, axis=1)) / dimensions, 10.0 * _SMALLEST, 0.1 * _LARGEST))
    # Which kind it is decides where the search begins: the views, all, or one of the others first.
    others = [np.full(len(usual), typical), *(typical - 6.0 * (1.0 - row) for row in np.eye(len(usual)))]
    starts = [np.concatenate([[0.7], start]) for start in (np.full(len(usual), typical - 6.0), *others)]
    starts = starts if near is None else [np.log(near * scale)]
    bounds = list(zip(lowest.tolist(), highest.tolist(), strict=True))
    # Here, since a robot that runs does not need it.
    from scipy.optimize import minimize

    found = [minimize(surprise, np.clip(start, lowest, highest), method="L-BFGS-B", bounds=bounds) for start in starts]
    best = min(found, key=lambda one: float(one.fun)).x
    # The scale of Student's t is not its variance; nor is that enough where tails are heavier still: errors that are common and those
    # that are rare ask for different scales then, and this is midway (logarithm).
    asked = np.quantile(explained(best)[1], _SHARES) / _CHI2[dimensions]
    stretch = max(_FREEDOM / (_FREEDOM - 2.0), float(np.sqrt(np.prod(asked))))
    return np.asarray(np.exp(best) * stretch / np.array([1.0, *usual]))

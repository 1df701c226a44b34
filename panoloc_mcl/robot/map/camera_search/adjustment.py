"""The search: Gauss-Newton over the camera's unknowns, from coarse features to fine ones, and what it leaves uncertain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from panoloc_mcl.robot.camera import AnyCamera
from panoloc_mcl.robot.map.camera_search.blocks import Equations
from panoloc_mcl.robot.map.camera_search.parameters import Parameter, changed
from panoloc_mcl.robot.progress import Progress, no_progress

Float64 = NDArray[np.float64]

#: Smoothing of the features in pixels, step by step: far first, then fine; and what is left once a search with larger pixels has ended.
SCHEDULE = (3.0, 3.0, 3.0, 3.0, 1.5, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0)
LAST_STEPS = (1.0, 1.0, 1.0, 1.0)
#: Further steps at the most, until one is small against the standard deviations: poses and a mirror's centre follow each other slowly.
MORE_STEPS = 10
_SETTLED = 0.3
# What is not known to a quarter of how far off it might be is not observable.
_OBSERVABLE = 0.25
# Of how far off an unknown may be, a step at the most.
_LARGEST_STEP = 0.3
_LEAST_AGREEMENT = 0.7
# Degrees of freedom of Student's t, usual where nothing is known of the outliers, and rounds in which its weights are found.
_FREEDOM, _REWEIGHTED = 4.0, 8


class Scene(Protocol):
    """Images that tell about a camera."""

    def equations(
        self, camera: AnyCamera, varied: list[tuple[AnyCamera, AnyCamera]], steps: Float64, sigma_px: float
    ) -> list[Equations]:
        """Of every image, at a camera, given those that a step of each unknown to either side makes of it."""

    def moved(self, step: Float64) -> None:
        """Take the steps of each image's own unknowns that go with a step of the common ones."""


@dataclass(frozen=True)
class Estimated:
    """What became of a parameter.

    Parameters
    ----------
    parameter : Parameter
    value : float
        The start where it cannot be told.
    sd : float
        Standard deviation; infinity where it cannot be told.
    """

    parameter: Parameter
    value: float
    sd: float

    @property
    def observable(self) -> bool:
        """Whether the data tell it."""
        return bool(np.isfinite(self.sd))


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The outcome of a search.

    Parameters
    ----------
    camera : AnyCamera
        With what was found.
    estimates : tuple of Estimated
    before, after : float
        Agreement of the images with their views.
    images : int
    covariance : float64 (n, n)
        Of all parameters by the scatter of the images alone; rows of those that cannot be told are zero.
    inverse : float64 (n, n)
        Of the normal matrix, with the same rows of zeros: how much of one parameter's change another makes up for.
    """

    camera: AnyCamera
    estimates: tuple[Estimated, ...]
    before: float
    after: float
    images: int
    covariance: Float64
    inverse: Float64

    def told(self, deviations: float) -> tuple[Estimated, ...]:
        """Parameters that differ from the description by more than so many standard deviations, given that the others do not.

        Where two look alike to the images, one that is as described says what the other is. The least certain goes first.
        """
        kept = [index for index, one in enumerate(self.estimates) if one.observable]
        start = np.array([one.parameter.start for one in self.estimates])
        values = np.array([one.value for one in self.estimates])
        covariance, inverse = self.covariance, self.inverse
        # What the search itself errs by adds to what is claimed, and has no part in which unknowns look alike.
        search = np.array([one.sd**2 if one.observable else 0.0 for one in self.estimates]) - np.diag(covariance)
        while kept:
            sds = np.sqrt((np.diag(covariance) + search)[kept])
            least = int(np.argmin(np.abs(values - start)[kept] / sds))
            if abs(values[kept[least]] - start[kept[least]]) > deviations * sds[least]:
                break
            gone = kept.pop(least)
            # Not by the covariance: the scatter of a few images says how sure values are, but not how they hang together.
            gain = inverse[:, gone] / max(inverse[gone, gone], 1e-18)
            values = values - gain * (values[gone] - start[gone])
            inverse = inverse - np.outer(gain, inverse[gone])
            held = np.eye(len(values))
            held[:, gone] -= gain
            covariance = held @ covariance @ held.T
        sds = np.sqrt(np.maximum(np.diag(covariance) + search, 0.0))
        return tuple(Estimated(self.estimates[index].parameter, float(values[index]), float(sds[index])) for index in kept)


def search(
    camera: AnyCamera,
    parameters: list[Parameter],
    scene: Scene,
    progress: Progress = no_progress,
    rough: Adjustment | None = None,
) -> Adjustment:
    """From far away, with large pixels; or on from there, with finer ones, until it settles.

    Parameters
    ----------
    camera : AnyCamera
        As it is described.
    parameters : list of Parameter
    scene : Scene
    progress : callable (done, total, what)
    rough : Adjustment, optional
        What a scene of large pixels told; then this one has finer ones.
    """
    if rough is None:
        return adjust(camera, parameters, scene, progress)
    begin = {one.parameter.name: one.value for one in rough.estimates}
    return adjust(camera, parameters, scene, progress, LAST_STEPS, begin, MORE_STEPS)


def adjust(
    camera: AnyCamera,
    parameters: list[Parameter],
    scene: Scene,
    progress: Progress = no_progress,
    schedule: tuple[float, ...] = SCHEDULE,
    begin: Mapping[str, float] | None = None,
    more: int = 0,
) -> Adjustment:
    """Turn the unknowns until the images agree best.

    Parameters
    ----------
    camera : AnyCamera
        Where to begin.
    parameters : list of Parameter
    scene : Scene
    progress : callable (done, total, what)
    schedule : tuple of float
        Smoothing of the features in pixels, step by step.
    begin : mapping of str to float, optional
        Values that an earlier search found; those of the description if left out.
    more : int
        Further steps at the most, as smooth as the last, until the search has settled.
    """
    start = np.array([parameter.start for parameter in parameters])
    values = start if begin is None else np.array([begin[parameter.name] for parameter in parameters])
    largest, accuracy = (np.array([getattr(parameter, name) for parameter in parameters]) for name in ("largest", "accuracy"))
    # What the search errs by more than that is left alone from the start: it would take others along.
    free = accuracy < _OBSERVABLE * largest
    before, step = np.nan, np.zeros(len(parameters))
    equations: list[Equations] = []
    covariance = inverse = np.zeros((len(parameters), len(parameters)))
    for round_, sigma in enumerate((*schedule, *(schedule[-1],) * more)):
        if round_ >= len(schedule) and np.all(np.abs(step) <= _SETTLED * np.sqrt(np.diag(covariance))):
            break
        equations = _equations(camera, parameters, values, scene, sigma)
        before = _agreement(equations) if round_ == 0 else before
        last = step
        step, covariance, inverse = _solved(equations, values - start, largest, free)
        if np.sum(step * last / np.diag(covariance)) >= 0.0:
            # What image and views do not share has derivatives, too, which make steps too short. Not any more after one has gone too
            # far: the search would go to and fro for ever.
            step = step / max(_agreement(equations), _LEAST_AGREEMENT) ** 2
        step = np.clip(step, -_LARGEST_STEP * largest, _LARGEST_STEP * largest)
        scene.moved(step)
        values = values + step
        if round_ == len(schedule) // 2:
            # From here on only what the data tell; the rest would drift along with it.
            free &= np.sqrt(np.diag(covariance)) < _OBSERVABLE * largest
            values[~free] = start[~free]
        progress(min(round_ + 1, len(schedule)), len(schedule), "camera")
    # The last step is as much as the search has not settled.
    covariance, inverse = (np.where(np.outer(free, free), one, 0.0) for one in (covariance, inverse))
    sd = np.where(free, np.sqrt(np.diag(covariance) + step**2 + accuracy**2), np.inf)
    estimates = tuple(Estimated(one, float(value), float(s)) for one, value, s in zip(parameters, values, sd, strict=True))
    found = changed(camera, parameters, {one.name: float(value) for one, value in zip(parameters, values, strict=True)})
    return Adjustment(found, estimates, before, _agreement(equations), len(equations), covariance, inverse)


def _equations(camera: AnyCamera, parameters: list[Parameter], values: Float64, scene: Scene, sigma: float) -> list[Equations]:
    def with_values(chosen: Float64) -> AnyCamera:
        return changed(camera, parameters, {one.name: float(v) for one, v in zip(parameters, chosen, strict=True)})

    steps = np.array([parameter.step for parameter in parameters])
    varied = []
    for index in range(len(values)):
        aside = steps * (np.arange(len(values)) == index)
        varied.append((with_values(values + aside), with_values(values - aside)))
    return scene.equations(with_values(values), varied, steps, sigma)


def _solved(
    equations: list[Equations], off: Float64, largest: Float64, free: NDArray[np.bool_]
) -> tuple[Float64, Float64, Float64]:
    """The step, held back towards the start as far as errors of that size are unlikely, covariance and inverse of the sum.

    Neighbouring pixels err together, so the covariance rests on how much the images differ among each other (sandwich estimator).
    Images whose world is no floor and walls count less, the more they contradict the rest: by Student's t, as in Lange, Little &
    Taylor, "Robust statistical modeling using the t distribution", JASA 1989.
    """
    count, chosen = len(equations), np.flatnonzero(free)
    step, covariance, whole = np.zeros(len(off)), np.diag(largest**2), np.diag(largest**2)
    if not len(chosen):
        return step, covariance, whole
    pick = np.ix_(chosen, chosen)
    normals = np.stack([one.normal[pick] for one in equations])
    rights = np.stack([one.right[chosen] for one in equations])
    scale = max(float(np.square(rights - rights.mean(axis=0)).sum()) / max(float(np.trace(normals.sum(axis=0))), 1e-12), 1e-12)
    prior = np.diag(scale / largest[chosen] ** 2)
    usual = float(chi2.median(len(chosen)))
    weights = np.ones(count)
    for _ in range(_REWEIGHTED):
        inverse = np.linalg.inv(np.einsum("k,kij->ij", weights, normals) + prior)
        found = inverse @ (weights @ rights - prior @ off[chosen])
        rest = rights - normals @ found
        # By how much each image alone would agree better elsewhere.
        gains = np.einsum("ki,ki->k", rest, np.linalg.solve(normals + prior, rest[:, :, None])[:, :, 0])
        gains *= usual / max(float(np.median(gains)), 1e-12)
        weights = (_FREEDOM + len(chosen)) / (_FREEDOM + gains)
    step[chosen] = found
    scattered = weights[:, None] * rest
    scattered = scattered - scattered.mean(axis=0)
    spread = inverse @ (scattered.T @ scattered * count / max(count - 1, 1) + prior * scale) @ inverse
    covariance[pick], whole[pick] = spread, inverse
    return step, covariance, whole


def _agreement(equations: list[Equations]) -> float:
    return sum(one.common for one in equations) / max(sum(one.energy for one in equations), 1e-12)

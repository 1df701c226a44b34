"""The search: Gauss-Newton over the camera's unknowns, from coarse features to fine ones, and what it leaves uncertain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import AnyCamera
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.calibration.blocks import Equations
from panoloc_mcl.tools.calibration.parameters import Parameter, changed

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
    """

    camera: AnyCamera
    estimates: tuple[Estimated, ...]
    before: float
    after: float
    images: int
    covariance: Float64

    def told(self, deviations: float) -> tuple[Estimated, ...]:
        """Parameters that differ from the description by more than so many standard deviations, given that the others do not.

        Where two look alike to the images, one that is as described says what the other is. The least certain goes first.
        """
        kept = [index for index, one in enumerate(self.estimates) if one.observable]
        start = np.array([one.parameter.start for one in self.estimates])
        values = np.array([one.value for one in self.estimates])
        covariance = self.covariance.copy()
        # What the search itself errs by adds to what is claimed, and has no part in which unknowns look alike.
        search = np.array([one.sd**2 if one.observable else 0.0 for one in self.estimates]) - np.diag(covariance)
        while kept:
            sds = np.sqrt((np.diag(covariance) + search)[kept])
            least = int(np.argmin(np.abs(values - start)[kept] / sds))
            if abs(values[kept[least]] - start[kept[least]]) > deviations * sds[least]:
                break
            gone = kept.pop(least)
            gain = covariance[:, gone] / max(covariance[gone, gone], 1e-18)
            values = values - gain * (values[gone] - start[gone])
            covariance = covariance - np.outer(gain, covariance[gone])
        sds = np.sqrt(np.maximum(np.diag(covariance) + search, 0.0))
        return tuple(Estimated(self.estimates[index].parameter, float(values[index]), float(sds[index])) for index in kept)


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
    values = np.array([parameter.start if begin is None else begin[parameter.name] for parameter in parameters])
    start = values.copy()
    largest = np.array([parameter.largest for parameter in parameters])
    free = np.ones(len(parameters), dtype=np.bool_)
    before, step = np.nan, np.zeros(len(parameters))
    equations: list[Equations] = []
    covariance = np.zeros((len(parameters), len(parameters)))
    for round_, sigma in enumerate((*schedule, *(schedule[-1],) * more)):
        if round_ >= len(schedule) and np.all(np.abs(step) <= _SETTLED * np.sqrt(np.diag(covariance))):
            break
        equations = _equations(camera, parameters, values, scene, sigma)
        before = _agreement(equations) if round_ == 0 else before
        step, covariance = _solved(equations, values - start, largest, free)
        # What image and views do not share has derivatives, too, which make steps too short.
        step = step / max(_agreement(equations), _LEAST_AGREEMENT) ** 2
        step = np.clip(step, -_LARGEST_STEP * largest, _LARGEST_STEP * largest)
        scene.moved(step)
        values = values + step
        if round_ == len(schedule) // 2:
            # From here on only what the data tell; the rest would drift along with it.
            free = np.sqrt(np.diag(covariance)) < _OBSERVABLE * largest
            values[~free] = start[~free]
        progress(min(round_ + 1, len(schedule)), len(schedule), "camera")
    # The last step is as much as the search has not settled.
    accuracy = np.array([parameter.accuracy for parameter in parameters])
    covariance = np.where(np.outer(free, free), covariance, 0.0)
    sd = np.where(free, np.sqrt(np.diag(covariance) + step**2 + accuracy**2), np.inf)
    estimates = tuple(Estimated(one, float(value), float(s)) for one, value, s in zip(parameters, values, sd, strict=True))
    found = changed(camera, parameters, {one.name: float(value) for one, value in zip(parameters, values, strict=True)})
    return Adjustment(found, estimates, before, _agreement(equations), len(equations), covariance)


def _equations(camera: AnyCamera, parameters: list[Parameter], values: Float64, scene: Scene, sigma: float) -> list[Equations]:
    def with_values(chosen: Float64) -> AnyCamera:
        return changed(camera, parameters, {one.name: float(v) for one, v in zip(parameters, chosen, strict=True)})

    steps = np.array([parameter.step for parameter in parameters])
    varied = []
    for index in range(len(values)):
        aside = steps * (np.arange(len(values)) == index)
        varied.append((with_values(values + aside), with_values(values - aside)))
    return scene.equations(with_values(values), varied, steps, sigma)


def _solved(equations: list[Equations], off: Float64, largest: Float64, free: NDArray[np.bool_]) -> tuple[Float64, Float64]:
    """The step, held back towards the start as far as errors of that size are unlikely, and the covariance of the sum.

    Neighbouring pixels err together, so the covariance rests on how much the images differ among each other (sandwich estimator).
    """
    normal = np.sum([one.normal for one in equations], axis=0)
    right = np.sum([one.right for one in equations], axis=0)
    scatter = np.sum([np.outer(one.right, one.right) for one in equations], axis=0) - np.outer(right, right) / len(equations)
    scale = max(float(np.trace(scatter)) / max(float(np.trace(normal)), 1e-12), 1e-12)
    prior = np.diag(scale / largest**2)
    chosen = np.flatnonzero(free)
    step, covariance = np.zeros(len(off)), np.diag(largest**2)
    if len(chosen):
        pick = np.ix_(chosen, chosen)
        inverse = np.linalg.inv(normal[pick] + prior[pick])
        step[chosen] = inverse @ (right - prior @ off)[chosen]
        spread = inverse @ (scatter[pick] * len(equations) / max(len(equations) - 1, 1) + prior[pick] * scale) @ inverse
        covariance[pick] = spread
    return step, covariance


def _agreement(equations: list[Equations]) -> float:
    return sum(one.common for one in equations) / max(sum(one.energy for one in equations), 1e-12)

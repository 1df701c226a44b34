"""From votes to probabilities, learnt from the references alone.

Every held-out reference is an image whose pose is known and that the map, made from the others, has not seen: as it is, occluded,
noisy, in other light; and upside down, which is an image of the same statistics that was taken nowhere in the map; and with one half
turned against the other, which is an image of a place beyond the map that shares its floor, or its walls, with a place in it. From
them follow how far votes at the true pose fall short of the best ones (the temperature of the likelihood), and how sure the best
pose is, given what the field and the refinement look like (logistic regression, Platt 1999).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.observation.disturbances import bars, blobs, gain, random_pixels, spatial_light
from panoloc_mcl.robot.observation.evidence import evidence, of_evidence, told_apart
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.regression import (
    expected_calibration_error,
    fitted,
    fitted_apart,
    log_loss,
    out_of_fold,
    probabilities,
)
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.synthesis.spacing import usual_spacing
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]

#: What images of a held-out reference suffer.
Disturb = Callable[[NDArray[np.uint8], np.random.Generator], NDArray[np.uint8]]


def dark_and_noisy(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Two fifths as bright, half of the pixels random."""
    return random_pixels(gain(image, rng, 0.4), rng, 0.5)


_OCCLUDED: Disturb = partial(bars, share=0.6)
CONDITIONS: tuple[Disturb | None, ...] = (None, _OCCLUDED, dark_and_noisy, spatial_light, partial(blobs, share=0.4))
#: As on another day: half as bright, and not everywhere alike.
DIM: Disturb = partial(spatial_light, gain=0.5)
#: And upside down, which was taken nowhere; the second and later ones mirrored, too, so that they are not the same image again.
NOWHERE: tuple[Disturb | None, ...] = (_OCCLUDED, None, dark_and_noisy, spatial_light)
#: And in two: what is above a row is turned against what is below.
HALVED: tuple[Disturb | None, ...] = (None, spatial_light, None)
# Rows above it, and by how much they are turned at the least, shares of all.
_UPPER, _TURNED_APART = (1.0 / 3.0, 2.0 / 3.0), 0.125
# Numbers that a map file keeps.
_KEPT = 20
# A pose is right within a quarter of the references' spacing, and never beyond these, metres; and within an angle. Nearer than the
# first, the definition of success, it is not a question of right or wrong, but of its covariance: references have errors themselves.
_RIGHT_IN_SPACINGS, _LEAST_RIGHT_M, _MOST_RIGHT_M = 0.25, 0.5, 1.0
_RIGHT_WITHIN = np.radians(10.0)
#: How often the best pose of an image is wrong, before it is seen: one image in three is of nowhere, or hidden, or found astray.
WRONG_SHARE = 1.0 / 3.0
# References so near to those that are judged do not teach: they see the same.
_NEIGHBOURS_IN_SPACINGS = 1.5
# Tolerances that are tried, as a share of the best votes.
_TOLERANCES = np.geomspace(0.01, 1.0, 41)
# Cells of a field that stand for all, closer to each other near the best, and how many each stands for.
_RANKS = (np.arange(256) + 0.5) / 256
_QUANTILES, _STANDS_FOR = 1.0 - np.square(_RANKS), 2.0 * _RANKS / len(_RANKS)
_OUTLIERS = 0.1
# Less information than this about a pose, nats, is none.
_TELLING = 0.1
_NOTHING_KEPT = Parts()


class HeldOut(Protocol):
    """A model that lacks one reference."""

    def observe(self, panorama: Panorama) -> VoteField:
        """Votes of one image."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What held-out references taught.

    Parameters
    ----------
    tolerance : float
        Root mean square of how far the votes at the true pose fall short of the best ones, as a share of these.
    field_weights, refined_weights : float64 (1, 4) and (2, 6)
        Of logistic regressions on `evidence`, the constant first: a row for each way to be wrong. The first is to be nowhere, hidden or
        astray; the second, which only refined poses are asked, is to be at another place that is like the true one in part.
    images : int
        How many images it rests on.
    log_loss, ece : float
        Of the confidence in refined poses (in the field's, where nothing is refined), for references that the weights were not
        learnt from: mean negative logarithm of the probability given to what was the case, and the expected calibration error.
    """

    tolerance: float
    field_weights: Float64
    refined_weights: Float64
    images: int
    log_loss: float
    ece: float

    def confidence(self, field: VoteField) -> float:
        """Probability that the best pose of a field, refined if it is, is right."""
        weights = self.field_weights if field.measurement is None else self.refined_weights
        return float(probabilities(evidence(field)[None], weights)[0])

    def array(self) -> Float64:
        """All of it, for a map file."""
        figures = [self.tolerance, self.images, self.log_loss, self.ece]
        return np.concatenate([figures, self.field_weights.ravel(), self.refined_weights.ravel()])

    @classmethod
    def of_array(cls, values: Float64, refined: bool = False) -> Calibration:
        """What `array` gave.

        Raises
        ------
        KeyError
            A version before gave it: it looked at other evidence, or did not learn what ``refined`` poses are worth.
        """
        if values.shape != (_KEPT,) or (refined and not values[8:].any()):
            raise KeyError("calibration")
        tolerance, images, log_loss, ece = (float(value) for value in values[:4])
        return cls(tolerance, values[4:8].reshape(1, 4), values[8:].reshape(2, 6), int(images), log_loss, ece)


class _Trials(NamedTuple):
    """A row for each image."""

    reference: NDArray[np.int64]
    field_evidence: Float64
    refined_evidence: Float64
    field_right: NDArray[np.bool_]
    refined_right: NDArray[np.bool_]
    upright: NDArray[np.bool_]
    halved: NDArray[np.bool_]
    shortfall: Float64
    shortfalls: Float64


def calibrate(
    held_out: Callable[[int], HeldOut],
    references: ReferencePanoramas,
    most_references: int,
    progress: Progress = no_progress,
    threads: int = 1,
    wrong_share: float = WRONG_SHARE,
    between: bool = True,
    parts: Parts = _NOTHING_KEPT,
) -> Calibration | None:
    """Learn from references that are held out one by one.

    Parameters
    ----------
    held_out : callable (index) -> model
        The model as though this reference had never been taken.
    references : ReferencePanoramas
    most_references : int
        So many at most are held out, evenly over all.
    progress : callable (done, total, what)
    threads : int
        References at work at once; the result does not depend on it.
    wrong_share : float
        Probability that the best pose of an image is wrong, before anything is seen of it, in (0, 1). What share of the trials is wrong
        does not matter.
    between : bool
        Whether places lie between the references. Where they are the references, one that is held out is twice as far from the next as
        a robot is at most: its best cell is found more seldom than a robot's, so that confidence errs to the safe side, and the
        tolerance is the one that tells right cells from wrong ones best.
    parts : Parts
        Where what is done is kept.

    Returns
    -------
    Calibration or None
        None where there is nothing to learn from: fewer than two references, or none that is found again.
    """
    trials = _all_trials(held_out, references, most_references, progress, threads, parts)
    if trials is None or not trials.field_right.any():
        return None
    positions, near = references.positions[trials.reference], _NEIGHBOURS_IN_SPACINGS * usual_spacing(references.positions)
    whole = ~trials.halved
    field_weights = fitted(trials.field_evidence[whole], trials.field_right[whole], wrong_share)[None]
    refined_weights = np.zeros((2, 6))
    judged, right = trials.field_evidence, trials.field_right
    if _is_refined(trials.refined_evidence[0]):
        judged, right = told_apart(trials.refined_evidence), trials.refined_right
        refined_weights = of_evidence(fitted_apart(judged, right, whole, wrong_share))
    said = out_of_fold(judged, right, whole, positions, near, wrong_share)
    tolerance: float | None
    if between:
        tolerance = float(np.sqrt(np.mean(trials.shortfall[trials.field_right] ** 2)))
    else:
        tolerance = most_likely_tolerance(trials.shortfall[trials.upright], trials.shortfalls[trials.upright])
    if tolerance is None:
        return None
    return Calibration(
        tolerance,
        field_weights,
        refined_weights,
        len(right),
        log_loss(said, right),
        expected_calibration_error(said, right),
    )


def right_within(references: ReferencePanoramas) -> float:
    """How far a pose in a map may be off and still be right, metres: what references farther apart tell is coarser."""
    return float(np.clip(_RIGHT_IN_SPACINGS * usual_spacing(references.positions), _LEAST_RIGHT_M, _MOST_RIGHT_M))


def _is_refined(evidence: Float64) -> bool:
    return not bool(np.isnan(evidence).any())


def _all_trials(
    held_out: Callable[[int], HeldOut],
    references: ReferencePanoramas,
    most_references: int,
    progress: Progress,
    threads: int,
    parts: Parts,
) -> _Trials | None:
    """What models without one reference each make of its images; of references spread evenly over all."""
    if len(references) < 2 or most_references < 2:
        return None
    chosen = np.unique(np.linspace(0, len(references) - 1, most_references).round().astype(np.int64))
    within = right_within(references)

    def tried(number: int) -> list[tuple[Any, ...]]:
        index = int(chosen[number])
        return _trials(held_out(index), references, index, within)

    columns = parts.listed("calibration", len(chosen), 2 * threads, tried, threads, progress)
    return _Trials(*columns) if columns else None


def most_likely_tolerance(shortfalls: Float64, of_map: Float64) -> float | None:
    """The tolerance that gives true poses the highest likelihood relative to its mean over the map; None where none gives more than 1.

    Parameters
    ----------
    shortfalls : float64 (n,)
        By how much the votes at the true pose of each image fall short of the best ones, as a share of these.
    of_map : float64 (n, 256)
        The same of cells all over the map, at `_QUANTILES` of the votes.
    """
    losses = []
    for tolerance in _TOLERANCES:
        true = np.exp(-0.5 * np.square(shortfalls / tolerance))
        mean = np.exp(-0.5 * np.square(of_map / tolerance)) @ _STANDS_FOR
        # An image in ten may be wrong about everything: it must not make all others cautious.
        losses.append(-np.log(_OUTLIERS + (1.0 - _OUTLIERS) * true / np.maximum(mean, 1e-9)).mean())
    return float(_TOLERANCES[int(np.argmin(losses))]) if min(losses) < -_TELLING else None


def _trials(model: HeldOut, references: ReferencePanoramas, index: int, within: float) -> list[tuple[Any, ...]]:
    """Images of a reference, each at a random heading, and what the model without it makes of them; right: ``within`` metres."""
    columns = references.geometry.width
    trials: list[tuple[Any, ...]] = []
    upright = references.pixels[index]
    mirrored = upright[::-1, ::-1]
    valid = None if references.valid is None else references.valid[index]
    images = [*((condition, upright) for condition in CONDITIONS), *zip(NOWHERE, [upright[::-1], *[mirrored] * 3], strict=True)]
    images += [(condition, _halved(upright, np.random.default_rng([index, 0, n]))) for n, condition in enumerate(HALVED)]
    for number, (condition, image) in enumerate(images):
        of_here, halved = number < len(CONDITIONS), number >= len(CONDITIONS) + len(NOWHERE)
        if halved and trials and not _is_refined(trials[0][2]):
            # Votes alone do not tell these.
            break
        rng = np.random.default_rng([index, number])
        shift = int(rng.integers(columns))
        pixels = np.roll(image, -shift, axis=1)
        if condition is not None:
            pixels = condition(np.ascontiguousarray(pixels), rng)
        seen = None if valid is None else np.roll(_flipped(valid, number), -shift, axis=1)
        field = model.observe(Panorama(pixels.astype(np.float32), seen))
        if field.problem:
            continue
        pose = np.array([*references.positions[index], -2.0 * np.pi * shift / columns])
        measured = field.measurement
        # The votes alone are no finer than the places.
        right = of_here and _is_right(field.best_pose, pose, max(within, field.places.spacing), field.gives_heading)
        refined_right = right if measured is None else of_here and _is_right(measured.pose, pose, within)
        best = max(field.peak.votes, 1e-12)
        trials.append(
            (
                index,
                evidence(field if measured is None else field.with_measurement(None)),
                np.full(5, np.nan) if measured is None else evidence(field),
                right,
                refined_right,
                of_here,
                halved,
                max(0.0, 1.0 - field.votes_at(pose) / best),
                np.asarray(1.0 - np.quantile(field.votes, _QUANTILES) / best, dtype=np.float64),
            )
        )
    return trials


def _flipped(valid: NDArray[np.bool_], number: int) -> NDArray[np.bool_]:
    """What is seen of the image of a trial: some are upside down, the later of these mirrored, too."""
    if not len(CONDITIONS) <= number < len(CONDITIONS) + len(NOWHERE):
        return valid
    return valid[::-1] if number == len(CONDITIONS) else valid[::-1, ::-1]


def _halved(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """An image whose upper part is turned against its lower one."""
    rows, columns = image.shape[:2]
    upper, turn = round(rng.uniform(*_UPPER) * rows), round(rng.uniform(_TURNED_APART, 1.0 - _TURNED_APART) * columns)
    turned = image.copy()
    turned[:upper] = np.roll(image[:upper], turn, axis=1)
    return turned


def _is_right(pose: Float64, truth: Float64, within: float, gives_heading: bool = True) -> bool:
    turned = abs(float(angle_difference(pose[2], truth[2])))
    return bool(np.hypot(*(pose - truth)[:2]) <= within + 1e-9 and (not gives_heading or turned <= _RIGHT_WITHIN))

"""Poses that can hardly be true, told by the references themselves: a neighbour's image, warped to where a reference is said to
stand, must fit that reference's image better at its heading than at any other.

A reference that no neighbour fits stands alone (behind walls, far from the others), or its pose is wrong. Which of both is told by
looking for its image elsewhere: views from all around, at all headings. Only where one of them fits clearly better than its own pose
does, it is doubted: no views are made from it, it is no place, and a note says where its image was probably taken. All limits are
relative to how well the images of this map fit each other, because images of a real camera fit less than rendered ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.kernels.warping import column_agreement
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.spacing import usual_spacing
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.robot.synthesis.virtual_places import synthetic_features, virtual_positions
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]
Features = tuple[Complex64, Bool]

_NEIGHBOURS = 4
# A turn is another one from here on, degrees: features of all scales in use agree less than half as well.
_OTHER_TURN_DEG = 20.0
# A gain so many standard deviations (by the median deviation) below the usual one is odd; oddity alone has no consequence.
_ODD_DEVIATIONS = 2.5
# More than this share of the references odd: nobody can say who is right.
_MOST_ODD = 0.25
# Farther from its neighbour than so many usual distances, and than this, a reference shows other things and cannot be judged.
_FAR_IN_SPACINGS, _FAR_M = 2.5, 1.0
# An image fits clearly better elsewhere where it gains half of what separates the map's images from chance, and where it leads what
# is farther off by so much. Images of other buildings reach 1.15.
_CLEARLY, _FOUND_LEAD = 0.5, 1.3
# How far around the others it is looked for, in their usual distance.
_SEARCH_IN_SPACINGS = 1.4
_RIVAL_IN_SPACINGS = 2.0
# Among more places than these, only around so many references that are most like it, by features averaged over blocks of pixels.
_EVERYWHERE_UP_TO, _MOST_ALIKE, _AVERAGED = 8000, 32, 4
_SAME_POSE_M, _SAME_POSE_RAD = 0.25, np.radians(8.0)
_KEPT_FEATURES = 64
_NOTHING_KEPT, _KEPT_TOGETHER = Parts(), 64
_NAMED = 5


@dataclass(frozen=True, eq=False)
class PoseCheck:
    """What the references' images say about their poses.

    Parameters
    ----------
    warped, unwarped : float64 (n,)
        Agreement (cosine) of every reference with the neighbour that fits best, warped to its pose and as it is; NaN without
        neighbours.
    helps : bool
        Whether views between the references can be made in this map.
    doubts : tuple of str
        One line for each reference whose image fits clearly better elsewhere.
    doubted : bool (n,)
        Which ones these are.
    alone : bool (n,)
        References that no neighbour fits, doubted ones included; the others may stand where they are said to.
    """

    warped: Float64
    unwarped: Float64
    helps: bool
    doubts: tuple[str, ...]
    doubted: Bool
    alone: Bool

    def notes(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """What the user should know, for references of these names."""
        if not self.helps:
            return (
                "no virtual places: views warped from one reference to the next fit no better than chance; check poses.csv and "
                "camera.height_m",
            )
        which = [name for name, alone in zip(names, self.alone & ~self.doubted, strict=True) if alone]
        if not which:
            return self.doubts
        listed = ", ".join(which[:_NAMED]) + (f" and {len(which) - _NAMED} more" if len(which) > _NAMED else "")
        return (
            *self.doubts,
            f"no virtual places around {listed}: no neighbour's image fits there; if there is no wall between, check the rows in "
            "poses.csv",
        )


class Fits(NamedTuple):
    """How every reference fits the neighbour that fits it best, warped to its pose; NaN without neighbours.

    Parameters
    ----------
    warped, unwarped : float64 (n,)
        Agreement (cosine) over what both show: warped, and as the neighbour's image is.
    own, other : float64 (n,)
        Correlation of the warped view with the image as it is given, and at most with the image turned to other headings.
    """

    warped: Float64
    unwarped: Float64
    own: Float64
    other: Float64


def check_poses(
    synthesizer: ViewSynthesizer,
    spacing: float,
    settings: VotesSettings,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> PoseCheck:
    """Judge the poses of all references by their neighbours.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
        Of all references, with their depths.
    spacing : float
        Usual distance between neighbouring references, metres.
    settings : VotesSettings
    progress : callable (done, total, what)
    threads : int
        References that are worked on at once; the result does not depend on it.
    parts : Parts
        Where what is done is kept.
    """
    fits = agreements(synthesizer, settings, progress, threads, parts)
    gain, none = fits.warped - fits.unwarped, np.zeros(len(fits.own), dtype=np.bool_)
    judged = np.isfinite(gain)
    fitting = judged & (fits.own > fits.other)
    # Between neighbours a few centimetres apart there is nothing to gain by warping; but it must not spoil most of them either.
    helps = 2 * int(fitting.sum()) > int(judged.sum()) and float(np.quantile(gain[judged], 0.75)) > 0.0
    if not helps:
        return PoseCheck(fits.warped, fits.unwarped, False, (), none, ~none)
    if settings.doubted_references == "keep":
        return PoseCheck(fits.warped, fits.unwarped, True, (), none, ~judged)
    usual = float(np.median(gain[judged]))
    deviation = 1.4826 * float(np.median(np.abs(gain[judged] - usual)))
    odd = ~fitting | (gain < usual - _ODD_DEVIATIONS * deviation)
    if odd.sum() > max(1.0, _MOST_ODD * len(odd)):
        odd = ~fitting
    doubts: dict[int, str] = {}
    if 0 < odd.sum() <= max(1.0, _MOST_ODD * len(odd)):
        doubts = dict(_found_elsewhere(synthesizer, odd, fits, spacing, settings, progress, threads, parts))
    doubted = none.copy()
    doubted[list(doubts)] = True
    return PoseCheck(fits.warped, fits.unwarped, True, tuple(doubts.values()), doubted, ~fitting | doubted)


def agreements(
    synthesizer: ViewSynthesizer,
    settings: VotesSettings,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> Fits:
    """How every reference fits the neighbour that fits it best, warped to its pose."""
    references = synthesizer.references
    count = len(references)
    # Depth comes from the neighbour's own surroundings, so it was not bent to fit this reference.
    distinct, place = np.unique(references.positions, axis=0, return_inverse=True)
    place = place.ravel()
    first_at = np.zeros(len(distinct), dtype=np.int64)
    first_at[place[::-1]] = np.arange(count)[::-1]
    tree = cKDTree(distinct)
    limit = max(_FAR_IN_SPACINGS * usual_spacing(distinct), _FAR_M)
    features = lru_cache(maxsize=_KEPT_FEATURES)(lambda index: orientations(references.panorama(index), settings))

    def best(index: int) -> Iterator[tuple[float, float, float, float]]:
        position = references.positions[index]
        distances, nearest = tree.query(position, k=min(_NEIGHBOURS + 1, len(distinct)))
        found = [(np.nan,) * 4]
        mine = features(index)
        for distance, other in zip(np.atleast_1d(distances), np.atleast_1d(nearest), strict=True):
            if other == place[index] or distance > limit:
                continue
            neighbour = int(first_at[other])
            view = orientations(synthesizer.view(neighbour, position, synthesizer.profile_at(neighbour, position)), settings)
            turns = _turns(mine[0], view[0])
            apart = round(_OTHER_TURN_DEG * len(turns) / 360.0)
            others = float(turns[apart + 1 : len(turns) - apart].max())
            found.append((_agreement(mine, view), _agreement(mine, features(neighbour)), float(turns[0]), others))
        yield max(found[1:] or found)

    return Fits(*parts.listed("poses of references", count, _KEPT_TOGETHER, best, threads, progress))


def _turns(image: Complex64, view: Complex64) -> Float64:
    """Correlation of an image with a view at every turn of it, float64 (columns,): turned on by k columns it was taken at k columns."""
    products = fft.ifft(np.sum(fft.fft(image, axis=1) * fft.fft(view, axis=1).conj(), axis=0)).real
    return np.asarray(products / max(float(np.linalg.norm(image)) * float(np.linalg.norm(view)), 1e-6), dtype=np.float64)


def _agreement(first: Features, second: Features) -> float:
    common, mine, theirs = (float(part.sum()) for part in column_agreement(*first, *second))
    return common / float(np.sqrt(max(mine * theirs, 1e-12)))


def _worth_a_look(
    images: list[Complex64], trusted: ViewSynthesizer, places: Float64, spacing: float, settings: VotesSettings
) -> Bool:
    """At which places (k,) each image (n,) is looked for, bool (n, k): all; of many those around the references most like it."""
    wanted = np.ones((len(images), len(places)), dtype=np.bool_)
    references = trusted.references
    if len(places) <= _EVERYWHERE_UP_TO or len(references) <= _MOST_ALIKE:
        return wanted
    every = (orientations(references.panorama(index), settings)[0] for index in range(len(references)))
    spectra = np.stack([_coarse_spectrum(z) for z in every]).conj()
    around = cKDTree(places).query_ball_point(references.positions, _SEARCH_IN_SPACINGS * spacing)
    for row, image in enumerate(images):
        likeness = fft.ifft(np.sum(_coarse_spectrum(image) * spectra, axis=1)).real.max(axis=1)
        wanted[row] = False
        for reference in np.argsort(-likeness, kind="stable")[:_MOST_ALIKE]:
            wanted[row, around[reference]] = True
    return wanted


def _coarse_spectrum(z: Complex64) -> Complex64:
    """Row spectra of averaged features, of unit length."""
    rows, columns = z.shape
    size = max(rows // _AVERAGED, 1), max(columns // _AVERAGED, 1)
    parts = [cv2.resize(part, size[::-1], interpolation=cv2.INTER_AREA) for part in (z.real.copy(), z.imag.copy())]
    spectrum = fft.fft(parts[0] + 1j * parts[1], axis=1)
    return np.asarray(spectrum / max(float(np.linalg.norm(spectrum)), 1e-12), dtype=np.complex64)


def _found_elsewhere(
    synthesizer: ViewSynthesizer,
    odd: Bool,
    fits: Fits,
    spacing: float,
    settings: VotesSettings,
    progress: Progress,
    threads: int,
    parts: Parts,
) -> Iterator[tuple[int, str]]:
    """Each odd reference whose image fits a view of another pose clearly better than that of its own, and a line that says so."""
    references = synthesizer.references
    trusted = synthesizer.of(np.flatnonzero(~odd))
    usual, chance = float(np.median(fits.own[~odd])), float(np.median(fits.other[~odd]))
    clearly = _CLEARLY * (usual - chance)
    indices = np.flatnonzero(odd)
    images = [orientations(references.panorama(int(index)), settings)[0] for index in indices]
    # Its own place is looked at like any other.
    grid = virtual_positions(trusted.references.positions, _SEARCH_IN_SPACINGS * spacing, settings.virtual_places)
    places = np.concatenate([grid, references.positions[indices]])
    wanted = _worth_a_look(images, trusted, places, spacing, settings)
    for row, beside in enumerate(cKDTree(places).query_ball_point(references.positions[indices], _SAME_POSE_M)):
        wanted[row, beside] = True
    looked_at = np.flatnonzero(wanted.any(axis=0))

    def compared(index: int) -> Iterator[tuple[int, int, float, float, float]]:
        place = int(looked_at[index])
        position = places[place]
        view, _ = synthetic_features(trusted, position, settings)
        for row in np.flatnonzero(wanted[:, place]).tolist():
            turns, own = _turns(images[row], view), 0.0
            turn = wrap_angle(2.0 * np.pi * np.arange(len(turns)) / len(turns))
            if np.hypot(*(position - references.positions[indices[row]])) <= _SAME_POSE_M:
                same = np.abs(turn) <= _SAME_POSE_RAD
                own = float(turns[same].max())
                turns[same] = 0.0
            yield row, place, float(turns.max()), float(turn[np.argmax(turns)]), own

    rows, at, score, heading, same = parts.listed(
        "references elsewhere", len(looked_at), _KEPT_TOGETHER, compared, threads, progress
    )
    scores, headings, own = np.zeros((len(indices), len(places))), np.zeros((len(indices), len(places))), np.zeros(len(indices))
    scores[rows, at], headings[rows, at] = score, heading
    np.maximum.at(own, rows, same)
    for row, index in enumerate(indices.tolist()):
        best = int(np.argmax(scores[row]))
        score, farther = scores[row, best], np.hypot(*(places - places[best]).T) > _RIVAL_IN_SPACINGS * spacing
        if score < max(own[row], chance) + clearly or score < _FOUND_LEAD * float(scores[row, farther].max(initial=0.0)):
            continue
        x, y = references.positions[index]
        best_x, best_y = places[best]
        yield (
            index,
            f"reference {references.names[index]} is left out: its image fits x = {best_x:.1f}, y = {best_y:.1f}, theta "
            f"{np.degrees(headings[row, best]):+.0f} degrees from what is given, not x = {x:g}, y = {y:g}; correct its row in "
            "poses.csv, or set observation.votes.doubted_references: keep",
        )

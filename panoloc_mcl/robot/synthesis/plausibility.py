"""Poses that cannot be true, told by the references themselves: a neighbour's image, warped to where a reference is said to stand,
must fit that reference's image better than it does as it is.

A reference that no neighbour fits has a wrong pose, or stands alone (behind walls, far from the others). Which of both is told by
looking for its image elsewhere: views from all around, at all headings. Where one of them fits, the pose is wrong, and the message
says where the image was probably taken. Where none does, the reference stays as it is, without virtual places around it.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.robot.kernels.warping import column_agreement
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.robot.synthesis.virtual_places import synthetic_features, virtual_positions

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]
Features = tuple[Complex64, Bool]

_NEIGHBOURS = 4
# Warping gains 0.3 to 0.6 of agreement where poses are right, and nothing where they are not; poses that are disturbed by 2 cm and
# 1 degree rms keep half of it at the least.
_LEAST_SHARE_OF_GAIN = 0.4
# Of images that have nothing to do with each other the best neighbour gains less than this by chance, in the median.
_LEAST_GAIN = 0.1
# More than this share of the references at fault: nobody can say who is right.
_MOST_AT_FAULT = 0.25
# Farther from its neighbour than so many usual distances, a reference shows other things and cannot be judged.
_FAR_IN_SPACINGS = 2.5
# An image is found elsewhere where it fits so well, and so much better than anywhere farther off. Images of other buildings reach
# 0.15, and 1.15 times as much as farther off.
_FOUND_AGREEMENT, _FOUND_LEAD = 0.2, 1.3
# How far around the others it is looked for, in their usual distance.
_SEARCH_IN_SPACINGS = 1.4
_RIVAL_IN_SPACINGS = 2.0
_SAME_POSE_M, _SAME_POSE_RAD = 0.25, np.radians(8.0)
_KEPT_FEATURES = 64
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
        Whether warping helps at all in this map.
    faults : tuple of str
        One line for each reference whose pose cannot be true, as its image fits elsewhere.
    alone : bool (n,)
        References that no neighbour fits; those without a fault may stand where they are said to.
    """

    warped: Float64
    unwarped: Float64
    helps: bool
    faults: tuple[str, ...]
    alone: Bool

    def notes(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """What the user should know, for references of these names."""
        if not self.helps:
            return (
                "no virtual places: the references do not fit each other; check poses.csv and camera.height_m, or take more",
            )
        if not self.alone.any():
            return ()
        which = [name for name, alone in zip(names, self.alone, strict=True) if alone]
        listed = ", ".join(which[:_NAMED]) + (f" and {len(which) - _NAMED} more" if len(which) > _NAMED else "")
        return (
            f"no virtual places around {listed}: no neighbour's image fits there; if there is no wall between, check the rows in "
            "poses.csv",
        )


def check_poses(
    synthesizer: ViewSynthesizer,
    spacing: float,
    settings: VotesSettings,
    progress: Progress = no_progress,
    threads: int = 1,
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
    """
    warped, unwarped = agreements(synthesizer, settings, progress, threads)
    gain = warped - unwarped
    judged = np.isfinite(gain)
    usual = float(np.median(gain[judged])) if judged.any() else 0.0
    if usual < _LEAST_GAIN:
        return PoseCheck(warped, unwarped, False, (), np.ones(len(gain), dtype=np.bool_))
    alone = ~judged | (gain < _LEAST_SHARE_OF_GAIN * usual)
    faults: tuple[str, ...] = ()
    if 0 < np.sum(alone) <= max(1.0, _MOST_AT_FAULT * len(alone)):
        faults = tuple(_found_elsewhere(synthesizer, alone, spacing, settings))
    return PoseCheck(warped, unwarped, True, faults, alone)


def agreements(
    synthesizer: ViewSynthesizer, settings: VotesSettings, progress: Progress = no_progress, threads: int = 1
) -> tuple[Float64, Float64]:
    """Agreement of every reference with the neighbour that fits best: warped, and as it is (see `PoseCheck`)."""
    references = synthesizer.references
    count = len(references)
    # Depth comes from the neighbour's own surroundings, so it was not bent to fit this reference.
    distinct, place = np.unique(references.positions, axis=0, return_inverse=True)
    place = place.ravel()
    first_at = np.zeros(len(distinct), dtype=np.int64)
    first_at[place[::-1]] = np.arange(count)[::-1]
    tree = cKDTree(distinct)
    limit = _FAR_IN_SPACINGS * _usual_distance(tree)
    features = lru_cache(maxsize=_KEPT_FEATURES)(lambda index: orientations(references.panorama(index), settings))

    def best(index: int) -> tuple[float, float]:
        position = references.positions[index]
        distances, nearest = tree.query(position, k=min(_NEIGHBOURS + 1, len(distinct)))
        pairs = []
        for distance, other in zip(np.atleast_1d(distances), np.atleast_1d(nearest), strict=True):
            if other == place[index] or distance > limit:
                continue
            neighbour = int(first_at[other])
            view = synthesizer.view(neighbour, position, synthesizer.profile_at(neighbour, position))
            mine = features(index)
            pairs.append((_agreement(mine, orientations(view, settings)), _agreement(mine, features(neighbour))))
        if not pairs:
            return np.nan, np.nan
        return max(pair[0] for pair in pairs), max(pair[1] for pair in pairs)

    found = np.empty((count, 2))
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for index, pair in enumerate(pool.map(best, range(count))):
            found[index] = pair
            progress(index + 1, count, "poses of references")
    return found[:, 0], found[:, 1]


def _usual_distance(tree: cKDTree) -> float:
    if tree.n < 2:
        return 0.0
    return float(np.median(np.asarray(tree.query(tree.data, k=2)[0])[:, 1]))


def _agreement(first: Features, second: Features) -> float:
    common, mine, theirs = (float(part.sum()) for part in column_agreement(*first, *second))
    return common / float(np.sqrt(max(mine * theirs, 1e-12)))


def _found_elsewhere(synthesizer: ViewSynthesizer, alone: Bool, spacing: float, settings: VotesSettings) -> Iterator[str]:
    """A line for each doubtful reference whose image fits a view of another pose, and for those whose place it takes."""
    doubtful = np.flatnonzero(alone)
    references = synthesizer.references
    trusted = synthesizer.of(np.flatnonzero(~alone))
    images = [orientations(references.panorama(int(index)), settings)[0] for index in doubtful]
    spectra = [fft.fft(z, axis=1) for z in images]
    norms = [float(np.linalg.norm(z)) for z in images]
    places = virtual_positions(trusted.references.positions, _SEARCH_IN_SPACINGS * spacing, settings.virtual_places)
    scores = np.zeros((len(doubtful), len(places)))
    headings = np.zeros(scores.shape)
    columns = references.geometry.width
    for place, position in enumerate(places):
        view, _ = synthetic_features(trusted, position, settings)
        spectrum, norm = fft.fft(view, axis=1).conj(), float(np.linalg.norm(view))
        for row, (image, mine) in enumerate(zip(spectra, norms, strict=True)):
            # Turned on by k columns the image was taken at k columns of heading.
            turns = fft.ifft(np.sum(image * spectrum, axis=0)).real / max(norm * mine, 1e-6)
            headings[row, place] = 2.0 * np.pi * np.argmax(turns) / columns
            scores[row, place] = turns.max()
    found: dict[int, Float64] = {}
    for row, index in enumerate(doubtful.tolist()):
        best = int(np.argmax(scores[row]))
        pose = np.array([*places[best], wrap_angle(headings[row, best])])
        rivals = scores[row, np.hypot(*(places - places[best]).T) > _RIVAL_IN_SPACINGS * spacing]
        moved = float(np.hypot(*(pose[:2] - references.positions[index])))
        if scores[row, best] < max(_FOUND_AGREEMENT, _FOUND_LEAD * float(rivals.max(initial=0.0))):
            continue
        if moved > _SAME_POSE_M or abs(pose[2]) > _SAME_POSE_RAD:
            found[index] = pose
    for index in doubtful.tolist():
        name, (x, y) = references.names[index], references.positions[index]
        given = f"reference {name}: its neighbours do not fit its pose (x = {x:g}, y = {y:g})"
        if index in found:
            best_x, best_y, turn = found[index]
            yield (
                f"{given}; its image fits x = {best_x:.1f}, y = {best_y:.1f}, theta {np.degrees(turn):+.0f} degrees from what is "
                "given; correct its row in poses.csv or take it out"
            )
            continue
        for other, pose in found.items():
            if np.hypot(*(pose[:2] - references.positions[index])) < 0.5 * spacing:
                yield f"{given}, where {references.names[other]} fits; correct its row in poses.csv or take it out"
                break

"""Which references a map is made from, and whether views can be synthesised from them.

A robot that stands, or a drive at a hundred images a metre, gives many references that tell little new; and some may have a pose that
their image denies. The map does without both.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.kernels.warping import column_agreement
from panoloc_mcl.robot.observation.overlap import squared_magnitude
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, check_poses, places_of, sweep_profiles
from panoloc_mcl.robot.synthesis.spacing import LEAST_REACH_M, usual_spacing
from panoloc_mcl.robot.unfinished import Parts

Features = tuple[NDArray[np.complex64], NDArray[np.bool_]]

# A kept image that agrees by this cosine explains half of the energy of the features.
_EXPLAINS_HALF = float(np.sqrt(0.5))
# Kept references around each one that it is compared with, the nearest first.
_COMPARED = 6
_KEPT_FEATURES = 64
_NOTHING_KEPT = Parts()


def check_texture(references: ReferencePanoramas, settings: VotesSettings) -> None:
    """Refuse references without any edge.

    Raises
    ------
    MapError
        One line for each.
    """
    rows, columns = references.geometry.shape
    faults = []
    for index, name in enumerate(references.names):
        z, _ = orientations(references.panorama(index), settings)
        if squared_magnitude(z).sum() < 1e-3 * rows * columns:
            faults.append(f"reference {name}: has no texture (black, saturated or constant); take it out of poses.csv")
    if faults:
        raise MapError(faults)


def sources_of(
    references: ReferencePanoramas,
    settings: VotesSettings,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> tuple[NDArray[np.int64], ViewSynthesizer | None, tuple[str, ...]]:
    """References that a map is made from, and what synthesises views from them.

    Parameters
    ----------
    references : ReferencePanoramas
    settings : VotesSettings
    progress : callable (done, total, what)
    threads : int
        References that are worked on at once; the result does not depend on it.
    parts : Parts
        Where what is done is kept.

    Returns
    -------
    used : int64 (m,)
        Indices of the references.
    synthesizer : ViewSynthesizer or None
        Of these; None where views cannot be made.
    notes : tuple of str
        What the user should know.
    """
    used = informative(references, settings) if settings.thinning else np.arange(len(references))
    synthesizer, trusted, notes = _synthesizer(references.of(used), settings, progress, threads, parts)
    return used[trusted], synthesizer, notes


def _synthesizer(
    references: ReferencePanoramas, settings: VotesSettings, progress: Progress, threads: int, parts: Parts
) -> tuple[ViewSynthesizer | None, NDArray[np.int64], tuple[str, ...]]:
    """What synthesises views, from which references, and what is to be said; None where views cannot be made."""
    everyone = np.arange(len(references))
    if not settings.virtual_places.enabled:
        return None, everyone, ()
    height = references.camera_height_m
    if height is None:
        note = "no virtual places: the camera's height is not known; give camera.height_m in dataset.yaml"
        return None, everyone, (note,)
    if len(np.unique(references.positions, axis=0)) < 2:
        alone = "a single reference has" if len(references) == 1 else "references that were all taken at one place have"
        return None, everyone, (f"no virtual places: {alone} no neighbours to see depth with",)
    profiles = sweep_profiles(references, height, settings, progress, threads, parts=parts)
    # As the map file keeps them, so that a map that was loaded gives the same votes to the last bit.
    profiles = profiles.astype(np.float32).astype(np.float64)
    every = ViewSynthesizer(references, profiles, height)
    check = check_poses(every, usual_spacing(references.positions), settings, progress, threads, parts)
    notes = check.notes(references.names)
    if not check.helps:
        return None, everyone, notes
    trusted = np.flatnonzero(~check.doubted)
    return ViewSynthesizer(references, profiles, height, check.alone).of(trusted), trusted, notes


def informative(references: ReferencePanoramas, settings: VotesSettings) -> NDArray[np.int64]:
    """References that are not half explained by one kept before them nearby, in their order.

    Images of one look that were taken farther apart are places to be told apart, and all stay.

    Parameters
    ----------
    references : ReferencePanoramas
    settings : VotesSettings

    Returns
    -------
    int64 (m,)
        Indices; the first is always among them.
    """
    features = lru_cache(maxsize=_KEPT_FEATURES)(lambda index: orientations(references.panorama(index), settings))
    kept: list[int] = []
    for index, position in enumerate(references.positions):
        apart = np.hypot(*(references.positions[kept] - position).T)
        near = [kept[k] for k in np.argsort(apart, kind="stable")[:_COMPARED] if apart[k] <= LEAST_REACH_M]
        if not any(_agreement(features(index), features(other)) >= _EXPLAINS_HALF for other in near):
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def _agreement(first: Features, second: Features) -> float:
    common, mine, theirs = (float(part.sum()) for part in column_agreement(*first, *second))
    return common / float(np.sqrt(max(mine * theirs, 1e-12)))


def places_between(
    references: ReferencePanoramas,
    everywhere: NDArray[np.float64],
    settings: VotesSettings,
    synthesizer: ViewSynthesizer | None,
) -> Places:
    """Of the references used, or between them; reports name the nearest of all references, taken at ``everywhere``."""
    if synthesizer is None:
        return Places(references.positions, None if len(references) == len(everywhere) else everywhere)
    spacing = usual_spacing(references.positions)
    return Places(places_of(synthesizer, spacing, settings.virtual_places), everywhere, least_reach=0.0)

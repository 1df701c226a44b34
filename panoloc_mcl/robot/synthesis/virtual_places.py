"""Places between the references, and what a camera would see there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings
from panoloc_mcl.robot.synthesis.spacing import LEAST_REACH_M, local_spacings
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]

# Votes fall to about two thirds within 0.2 m of a place: places this far apart leave no gap between their peaks.
_LARGEST_SPACING_M, _SMALLEST_SPACING_M = 0.25, 0.15
# Half the diagonal of a grid's cell, and a little more: the middle of every cell is covered.
_REACH_IN_SPACINGS = 0.75
# Images of two sources are weighted by 1 / (distance + this).
_NEAR_M = 0.05
_SAME_PLACE_M = 1e-6


def virtual_positions(
    references: Float64, reference_spacing: float, settings: VirtualPlacesSettings, around: Float64 | None = None
) -> Float64:
    """A grid of places over the ground that the references cover.

    Parameters
    ----------
    references : float64 (n, 2)
        Where they were taken, metres.
    reference_spacing : float
        Distance between neighbouring references, metres.
    settings : VirtualPlacesSettings
    around : float64 (n,), optional
        The same around each reference, where it is not everywhere the same.

    Returns
    -------
    float64 (k, 2)
        Metres.
    """
    spacing = settings.spacing_m or float(np.clip(reference_spacing / 4.0, _SMALLEST_SPACING_M, _LARGEST_SPACING_M))
    reaches = np.maximum(
        _REACH_IN_SPACINGS * np.broadcast_to(reference_spacing if around is None else around, len(references)), LEAST_REACH_M
    )
    low = references.min(axis=0) - int(np.ceil(reaches.max() / spacing)) * spacing
    # Only cells around references: the ground between places far apart may be vast. By row, then by column.
    cells = []
    for reach in np.unique(reaches):
        steps = int(np.ceil(reach / spacing))
        beside = np.arange(-steps - 1, steps + 2)
        chosen = references[reaches == reach]
        nearest = np.rint((chosen - low) / spacing).astype(np.int64)
        rows = nearest[:, 1, None, None] + beside[:, None]
        columns = nearest[:, 0, None, None] + beside[None, :]
        near = np.unique(np.stack(np.broadcast_arrays(rows, columns), axis=-1).reshape(-1, 2), axis=0)
        cells.append(near[cKDTree(chosen).query(low + spacing * near[:, ::-1])[0] <= reach + 1e-9])
    grid: Float64 = low + spacing * np.unique(np.concatenate(cells), axis=0)[:, ::-1]
    return grid


def places_of(synthesizer: ViewSynthesizer, reference_spacing: float, settings: VirtualPlacesSettings) -> Float64:
    """Virtual places around the references that views can be made from, and after them the references that stand alone.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
    reference_spacing : float
        Distance between neighbouring references, metres.
    settings : VirtualPlacesSettings

    Returns
    -------
    float64 (k, 2)
        Metres.
    """
    positions, alone = synthesizer.references.positions, synthesizer.alone
    sources = positions[~alone]
    places = virtual_positions(sources, reference_spacing, settings, local_spacings(sources))
    if not alone.any():
        return places
    by_themselves = np.unique(positions[alone], axis=0)
    places = places[cKDTree(by_themselves).query(places)[0] > _SAME_PLACE_M]
    return np.concatenate([places, by_themselves])


def synthetic_features(synthesizer: ViewSynthesizer, position: Float64, settings: VotesSettings) -> tuple[Complex64, Bool]:
    """Features of the view at a place, from the nearest references, the nearer the more.

    Returns
    -------
    z : complex64 (rows, columns)
    usable : bool (rows, columns)
        Where at least one source shows something.
    """
    references = synthesizer.references
    here = np.flatnonzero(np.hypot(*(references.positions - position).T) < _SAME_PLACE_M)
    # A reference that does not see all is completed by its neighbours, if it has any.
    if len(here) and (references.valid is None or synthesizer.alone[here[0]]):
        return orientations(references.panorama(int(here[0])), settings)
    rows, columns = references.geometry.shape
    total = np.zeros((rows, columns), dtype=np.complex64)
    weights = np.zeros((rows, columns), dtype=np.float32)
    for distance, source in zip(*synthesizer.sources_around(position, settings.virtual_places.sources), strict=True):
        view = synthesizer.view(int(source), position, synthesizer.profile_at(int(source), position))
        z, usable = orientations(view, settings)
        weight = np.float32(synthesizer.trust[source] / (distance + _NEAR_M))
        total += weight * z
        weights += weight * usable
    seen = weights > 0.0
    total[seen] /= weights[seen]
    return total, seen

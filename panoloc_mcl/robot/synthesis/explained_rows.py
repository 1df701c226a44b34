"""Rows of the references that a floor and walls explain; ceilings, skies and the ground at the robot's feet are left out by themselves.

Between a floor and a wall every pixel has a known distance, so a neighbour's image can be brought to a reference. Above, there may be a
ceiling at any height; straight below, there is the robot. Rows are used as far as neighbours agree in them about as well as in the
middle of the field, and not near the zenith and the nadir, where all columns show the same spot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.references import ReferencePanoramas, References, read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.depth import CORE_DEG, core_rows, sweep_profiles, with_rows
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer

Float64 = NDArray[np.float64]

_EDGE_DEG = 1.0  # a field that ends so close to the core is used whole
# Of the agreement in the core, over a few degrees of rows; what is below it by less than so many standard errors is left as it is.
_SHARE, _SMOOTHING_DEG, _STANDARD_ERRORS = 0.6, 5.0, 2.0
# Length of a row on the sphere, as a share of the horizon's. Pixels of shorter rows are not independent of each other: with the floor
# below -60 degrees, poses of the simulator's hall were off by up to 0.2 m at the goals, where they are off by 3 mm without.
_SHORTEST_ROW = 0.5
# References looked at: clusters of neighbours.
_CLUSTERS, _CLUSTER_SIZE = 3, 6


def explained(
    source: References,
    settings: VotesSettings,
    as_compared: Callable[[ReferencePanoramas], ReferencePanoramas],
    threads: int = 1,
) -> tuple[References, tuple[str, ...]]:
    """References that become panoramas of the rows that are worth comparing, and a note of what is left out.

    Parameters
    ----------
    source : References
    settings : VotesSettings
    as_compared : callable
        References in the resolution in which images are compared, so that enlarged images keep the same rows.
    threads : int

    Raises
    ------
    DatasetError, ImageError
        As `read_references`, of references whose field is that high.
    """
    whole = source.geometry
    if source.rows is not None or (
        whole.elevation_bottom_deg >= CORE_DEG[0] - _EDGE_DEG and whole.elevation_top_deg <= CORE_DEG[1] + _EDGE_DEG
    ):
        return source, ()
    compared = as_compared(read_references(source))
    rows = explained_rows(compared, settings, threads)
    source = replace(source, tall=all_tell_depth(with_rows(compared, rows), settings, threads))
    if rows == slice(0, compared.geometry.height):
        return source, ()
    scale = whole.height / compared.geometry.height
    found = replace(source, rows=(round(rows.start * scale), round(rows.stop * scale)))
    kept = f"{found.geometry.elevation_bottom_deg:.0f} to {found.geometry.elevation_top_deg:.0f}"
    given = f"{whole.elevation_bottom_deg:.0f} to {whole.elevation_top_deg:.0f}"
    return found, (f"elevations {kept} of {given} degrees are used: a floor and walls do not explain the others",)


def explained_rows(references: ReferencePanoramas, settings: VotesSettings, threads: int = 1) -> slice:
    """The rows that are worth comparing.

    Parameters
    ----------
    references : ReferencePanoramas
    settings : VotesSettings
    threads : int
        References at work at once; the result does not depend on it.

    Returns
    -------
    slice
        Of rows: all, where the field ends within -60 and 30 degrees, or where nothing can be told (no height, no neighbours).
    """
    geometry = references.geometry
    every = slice(0, geometry.height)
    elevations = np.degrees(geometry.elevation_of_row(np.arange(geometry.height)))
    core, height = core_rows(geometry), references.camera_height_m
    if core == every or height is None:
        return every
    if len(np.unique(references.positions, axis=0)) < _CLUSTER_SIZE:
        return core
    chosen = references.of(_clusters(references.positions))
    profiles = sweep_profiles(chosen, height, settings, threads=threads)
    agreement = _agreement_of_rows(ViewSynthesizer(chosen, profiles, height), settings)
    width = max(1, round(_SMOOTHING_DEG / abs(float(elevations[1] - elevations[0]))))
    smooth = uniform_filter1d(agreement, width, axis=1, mode="nearest")
    mean, error = smooth.mean(axis=0), smooth.std(axis=0) / np.sqrt(len(smooth))
    good = mean + _STANDARD_ERRORS * error >= _SHARE * np.median(mean[core])
    good &= np.cos(np.radians(elevations)) >= _SHORTEST_ROW
    first, last = core.start, core.stop - 1
    while first > 0 and good[first - 1]:
        first -= 1
    while last < geometry.height - 1 and good[last + 1]:
        last += 1
    return slice(first, last + 1)


def all_tell_depth(references: ReferencePanoramas, settings: VotesSettings, threads: int = 1) -> bool:
    """Whether depths by all rows are no worse than by the core, where both must hold: in the core, for neighbours that told no depth.

    Trees stand higher than walls, and a ceiling is no wall; only the images can tell which of them is above.
    """
    core, height = core_rows(references.geometry), references.camera_height_m
    every = slice(0, references.geometry.height)
    if core == every or height is None or len(np.unique(references.positions, axis=0)) < _CLUSTER_SIZE:
        return False
    chosen = references.of(_clusters(references.positions))
    tree = cKDTree(chosen.positions)
    distances, nearest = (np.asarray(part) for part in tree.query(chosen.positions, k=len(chosen)))
    others = [row[apart > 1e-6].tolist() for row, apart in zip(nearest, distances, strict=True)]
    # The nearest is held out.
    tellers = [row[1 : 1 + settings.virtual_places.neighbours] for row in others]
    agreement = []
    for tall in (False, True):
        profiles = sweep_profiles(replace(chosen, tall=tall), height, settings, threads=threads, neighbours=tellers)
        rows = _agreement_of_rows(ViewSynthesizer(chosen, profiles, height), settings)
        agreement.append(float(rows[:, core].mean()))
    return agreement[1] >= agreement[0]


def _clusters(positions: Float64) -> NDArray[np.int64]:
    """Some references with their neighbours, evenly over all."""
    middles = np.linspace(0, len(positions) - 1, _CLUSTERS + 2).round().astype(int)[1:-1]
    _, nearest = cKDTree(positions).query(positions[middles], k=min(_CLUSTER_SIZE, len(positions)))
    return np.unique(nearest).astype(np.int64)


def _agreement_of_rows(synthesizer: ViewSynthesizer, settings: VotesSettings) -> Float64:
    """Cosine of every row of every reference with its nearest neighbour's view, float64 (n, rows)."""
    references = synthesizer.references
    common = np.zeros((len(references), references.geometry.height))
    energy = np.full(common.shape, 1e-9)
    tree = cKDTree(references.positions)
    for index, position in enumerate(references.positions):
        distances, nearest = (np.atleast_1d(part) for part in tree.query(position, k=len(references)))
        neighbour = int(nearest[np.argmax(distances > 1e-6)])
        mine, usable = orientations(references.panorama(index), settings)
        view, seen = orientations(synthesizer.view(neighbour, position, synthesizer.profiles[index]), settings)
        both = usable & seen
        common[index] = (both * (mine * view.conj()).real).sum(axis=1)
        energy[index] += 0.5 * (both * (np.abs(mine) ** 2 + np.abs(view) ** 2)).sum(axis=1)
    return np.asarray(common / energy)

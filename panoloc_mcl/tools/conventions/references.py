"""Conventions of a map's references: poses, units, axes and the sense of the panoramas, told by neighbouring images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.references import References
from panoloc_mcl.tools.conventions.motion_table import BEARINGS, Views
from panoloc_mcl.tools.conventions.readings import (
    AS_WRITTEN,
    CLOCKWISE,
    CLOCKWISE_DEGREES,
    DEGREES,
    FLIPPED,
    MIRRORED,
    MIRRORED_Y,
    SWAPPED,
    TURNED_OVER,
    Fit,
    Reading,
    best_fit,
    heading_off,
)

Float64 = NDArray[np.float64]

_MOST_PAIRS = 48
_NEIGHBOURS = 4
# References farther apart than this hardly show the same: metres are then tried as smaller units.
_FAR_M = 8.0
_UNITS = ((0.01, "centimetres"), (0.001, "millimetres"), (0.3048, "feet"))
# Heights that people write in another unit, or at half or double by a slip.
# A floor is little of what is seen: half the height costs an eighth of the agreement in halls, a quarter in offices.
_LEAST_GAIN_OF_HEIGHT, _FEWEST_PAIRS_OF_HEIGHT = 0.08, 12
# From the lowest vacuum cleaner to the mast of a large robot, metres.
_LOWEST_M, _HIGHEST_M = 0.03, 10.0
_HEIGHTS = (0.5, 2.0, 0.001, 0.01, 100.0, 1000.0)
_READINGS = (
    AS_WRITTEN,
    DEGREES,
    CLOCKWISE,
    CLOCKWISE_DEGREES,
    SWAPPED,
    # Where all references have one heading, mirrored images and a mirrored y are the same: the line names both.
    MIRRORED,
    MIRRORED_Y,
    FLIPPED,
    TURNED_OVER,
    *(heading_off((360.0 * step / BEARINGS + 180.0) % 360.0 - 180.0) for step in range(1, BEARINGS)),
)


def reference_fit(references: References) -> Fit | None:
    """The reading of references that fits far better than what is written; None if none does."""
    poses = references.poses
    pairs, distances = _neighbours(poses)
    if not pairs or (references.sds is not None and np.isinf(references.sds[:, 1]).any()):
        # Without headings, none of the other conventions shows.
        return None
    views = Views(references.camera, references.image_size, references.files)
    usable = views.usable(pairs)
    pairs, distances = [pairs[number] for number in usable], distances[usable]
    if not pairs:
        return None
    first, second = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
    moved = between(poses[first], poses[second])
    if float(np.median(distances)) > _FAR_M:
        return _unit_fit(views, pairs, moved)
    table = views.table(pairs, distances, flips=True)
    scores = [(reading, reading.agreement(table, poses, pairs)) for reading in _READINGS]
    return best_fit(scores) or _height_fit(views, pairs, moved, references.camera.height_m)


def height_findings(references: References) -> list[str]:
    """One line where the camera stands higher than any robot's; empty otherwise."""
    height = references.camera.height_m
    if height is None or height <= _HIGHEST_M:
        return []
    return [f"{references.path}: camera.height_m = {height:g} is higher than any robot; write metres"]


def reference_findings(references: References) -> list[str]:
    """One line for a convention that fits far better than what is written; empty where none does."""
    fit = reference_fit(references)
    where = str(references.path / "poses.csv")
    return height_findings(references) or ([] if fit is None else [fit.line(where)])


def _unit_fit(views: Views, pairs: Sequence[tuple[int, int]], moved: Float64) -> Fit | None:
    scores = [(AS_WRITTEN, views.along(pairs, moved))]
    for factor, unit in _UNITS:
        scores.append((Reading(unit, f"x and y fit as {unit}", "write metres"), views.along(pairs, moved, factor)))
    return best_fit(scores)


def _height_fit(views: Views, pairs: Sequence[tuple[int, int]], moved: Float64, height_m: float | None) -> Fit | None:
    if height_m is None or len(pairs) < _FEWEST_PAIRS_OF_HEIGHT:
        return None
    scores = []
    for factor in (1.0, *_HEIGHTS):
        if factor != 1.0 and not _LOWEST_M <= height_m * factor <= _HIGHEST_M:
            # Another unit is only meant where it gives the height of a robot.
            continue
        views.use_height(height_m * factor)
        said = f"camera.height_m fits as {height_m * factor:g} instead of {height_m:g}"
        scores.append((Reading("height", said, "correct it"), views.along(pairs, moved)))
    views.use_height(height_m)
    return best_fit(scores, _LEAST_GAIN_OF_HEIGHT)


def _neighbours(poses: Float64) -> tuple[list[tuple[int, int]], Float64]:
    """Some pairs of references near each other, evenly over all, and how far they are apart."""
    if len(poses) < 2:
        return [], np.zeros(0)
    tree = cKDTree(poses[:, :2])
    distances, nearest = (np.asarray(part) for part in tree.query(poses[:, :2], k=min(_NEIGHBOURS + 1, len(poses))))
    found: dict[tuple[int, int], float] = {}
    usual = float(np.median(distances[:, 1]))
    for first, (row, away) in enumerate(zip(nearest, distances, strict=True)):
        for second, distance in zip(row[1:].tolist(), away[1:].tolist(), strict=True):
            if distance <= 1.6 * max(usual, 0.05) and first != second and (second, first) not in found:
                found[first, second] = distance
    chosen = np.unique(np.linspace(0, len(found) - 1, min(_MOST_PAIRS, len(found))).round().astype(np.int64))
    pairs = list(found)
    return [pairs[number] for number in chosen], np.array([found[pairs[number]] for number in chosen])

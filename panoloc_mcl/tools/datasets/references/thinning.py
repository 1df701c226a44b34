"""A part of the references: what a map costs that is made of fewer pictures."""

from __future__ import annotations

import re

import numpy as np

from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.references import References

#: The part that is everything.
ALL = "all"
_DISTANCES = {"checkerboard": np.sqrt(2.0), "fourth": 2.0}
_KNOWN = "all, checkerboard (every second of a grid), fourth (every fourth), or a distance like every-2m"
# Rows of a grid are told apart to a tenth of its spacing, distances to a twentieth.
_ROW, _SLACK = 0.1, 0.05


def check_part(part: str, source: str = "references:") -> None:
    """Find out whether there is such a part.

    Raises
    ------
    ConfigError
        A word that `thinned` does not know; ``source`` stands before it.
    """
    if part != ALL and part not in _DISTANCES and not _metres(part):
        raise ConfigError(f"{source} {part}: no such part; use {_KNOWN}")


def thinned(references: References, part: str, source: str = "references:") -> References:
    """A part of the references: row by row, each that is far enough from all that were kept before it.

    On a grid ``checkerboard`` keeps every second reference (what is nearer than a cell's diagonal goes) and ``fourth`` every fourth;
    scattered references thin out to that distance.

    Parameters
    ----------
    references : References
    part : str
        ``all``, ``checkerboard``, ``fourth``, or ``every-Dm`` with a distance D in metres.
    source : str
        What to call the part in a fault.

    Raises
    ------
    ConfigError
        Another word, or fewer than 2 references left.
    """
    check_part(part, source)
    if part == ALL:
        return references
    positions = references.poses[:, :2]
    spacing = _spacing(references)
    metres = _metres(part)
    distance = _DISTANCES[part] * spacing if metres is None else metres
    order = np.lexsort((positions[:, 0], np.rint(positions[:, 1] / (_ROW * spacing))))
    kept: list[int] = []
    for index in order:
        apart = np.hypot(*(positions[kept] - positions[index]).T)
        if np.all(apart >= distance - _SLACK * spacing):
            kept.append(int(index))
    if len(kept) < 2:
        raise ConfigError(f"{source} {part}: leaves {len(kept)} of {len(references)} references; use a shorter distance")
    kept.sort()
    return references.of(np.array(kept, dtype=np.int64))


def _metres(part: str) -> float | None:
    match = re.fullmatch(r"every-(\d+(?:\.\d+)?)m", part)
    return float(match[1]) if match else None


def _spacing(references: References) -> float:
    """Median distance of a position to its nearest neighbour, metres; several references at one position are one."""
    # Slow to import, and only this needs it.
    from scipy.spatial import cKDTree

    distinct = np.unique(references.poses[:, :2], axis=0)
    if len(distinct) < 2:
        return 1.0
    return float(np.median(np.asarray(cKDTree(distinct).query(distinct, k=2)[0])[:, 1]))

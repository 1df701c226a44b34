"""References with mended poses, and what a user should know of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.references import ReferencePanoramas, References

_NAMED = 8


@dataclass(frozen=True, eq=False)
class Mended:
    """References with mended poses.

    Parameters
    ----------
    source : References
        Those that are in the map, with poses as the map holds them.
    panoramas : ReferencePanoramas
        The same, read and turned to heading 0.
    keyframes : Keyframes
    notes : tuple of str
        What the user should know.
    """

    source: References
    panoramas: ReferencePanoramas
    keyframes: Keyframes
    notes: tuple[str, ...]


def notes_of(keyframes: Keyframes) -> Iterator[str]:
    """One line for all that moved, and one for each that was far off."""
    moved, turned = keyframes.moved_m, np.abs(np.degrees(keyframes.turned))
    anew = [keyframes.names.index(name) for name in keyframes.placed_anew]
    others = np.setdiff1d(np.arange(len(keyframes)), anew)
    if np.any(moved[others] > 0.0) or np.any(turned[others] > 0.0):
        yield (
            f"poses of {len(others)} references corrected by the images: {100 * np.median(moved[others]):.1f} cm and "
            f"{np.median(turned[others]):.2f} degrees in the median, {100 * moved[others].max():.1f} cm and "
            f"{turned[others].max():.2f} degrees at the most"
        )
    for index in anew[:_NAMED]:
        x, y, heading = keyframes.poses[index]
        yield (
            f"{keyframes.names[index]}: its neighbours do not fit the given pose; placed anew at x = {x:.2f}, y = {y:.2f}, theta = "
            f"{heading:.2f}, {moved[index]:.2f} m and {turned[index]:.0f} degrees from it"
        )
    if len(anew) > _NAMED:
        yield f"and {len(anew) - _NAMED} more placed anew: {', '.join(keyframes.placed_anew[_NAMED:])}"
    for name, why in keyframes.left_out.items():
        yield f"{name}: {why}; left out of the map"

"""What is read off a vote field: its best cell, and the pose that one image tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Peak:
    """The best cell of a vote field.

    Parameters
    ----------
    place : int
    heading : float
        Radians; between the field's headings where they are equally spaced. NaN where the image gives none.
    votes : float
    margin : float
        Votes ahead of the best rival elsewhere, as a share of ``votes``; 0 = a tie, 1 = no rival at all.
    """

    place: int
    heading: float
    votes: float
    margin: float


@dataclass(frozen=True, eq=False)
class Guess:
    """What one image says by itself.

    Parameters
    ----------
    pose : float64 (3,)
        x, y, heading of the best cell, refined where the model refines; metres and radians. Heading 0 where the image gives none.
    probability : float
        That the pose is right: calibrated by held-out references, or, where the model knows no doubt, the share of the likelihood that
        lies around the best cell.
    """

    pose: Float64
    probability: float

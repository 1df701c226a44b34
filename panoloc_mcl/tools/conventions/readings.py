"""Ways to read poses and images, and which of them fits the images far better than what is written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import between
from panoloc_mcl.tools.conventions.motion_table import MotionTable

Float64 = NDArray[np.float64]

# A reading is named if it agrees so much better, as a share of its own agreement, in so many standard errors of the difference over
# the pairs, and at all. Set on rendered halls and offices: the right reading gains a third at the least there, by ten errors.
_LEAST_GAIN, _LEAST_ERRORS, _LEAST_AGREEMENT = 0.15, 4.0, 0.1
_FEWEST_PAIRS = 6
# Readings that agree as well as the best within this share are as likely; the first of them is named.
_AS_GOOD = 0.02


@dataclass(frozen=True)
class Reading:
    """One way to read what is written.

    Parameters
    ----------
    kind : str
        A word for programs.
    said : str
        How it fits, such as "theta fits as degrees".
    remedy : str
    poses : callable (poses (n, 3)) -> (n, 3)
        What the poses are by this reading.
    bearing : float
        The camera looks so far to the left of what is written, radians.
    mirrored, flipped : bool
        Left and right, or up and down, of the images are changed over.
    turns : bool
        False: the camera never turns, whatever is written.
    """

    kind: str
    said: str
    remedy: str
    poses: Callable[[Float64], Float64] = lambda poses: poses
    bearing: float = 0.0
    mirrored: bool = False
    flipped: bool = False
    turns: bool = True

    def agreement(self, table: MotionTable, poses: Float64, pairs: Sequence[tuple[int, int]]) -> Float64:
        """Of each pair (pairs,) by this reading."""
        read = self.poses(poses)
        first, second = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
        moved = between(read[first], read[second])
        bearings = np.arctan2(moved[:, 1], moved[:, 0]) - self.bearing
        return table.at(bearings, moved[:, 2] * self.turns, mirrored=self.mirrored, flipped=self.flipped)


AS_WRITTEN = Reading("as written", "", "")
DEGREES = Reading(
    "degrees", "theta fits as degrees", "write radians", lambda p: np.column_stack([p[:, :2], np.radians(p[:, 2])])
)
_HARDLY = (
    "still",
    "its heading changes, though the images hardly turn",
    "see whether headings were measured, whether they are in degrees, and whether one clock stamps poses and images",
)
# The camera goes where the heading has it, or always looks the same way.
STILL = (Reading(*_HARDLY, turns=False), Reading(*_HARDLY, lambda p: p * [1.0, 1.0, 0.0]))
CLOCKWISE = Reading(
    "clockwise",
    "theta fits as an angle that grows clockwise",
    "write it counter-clockwise, with the other sign",
    lambda p: p * [1.0, 1.0, -1.0],
)
CLOCKWISE_DEGREES = Reading(
    "clockwise degrees",
    "theta fits as degrees that grow clockwise",
    "write radians, counter-clockwise",
    lambda p: np.column_stack([p[:, :2], -np.radians(p[:, 2])]),
)
SWAPPED = Reading("swapped", "x and y fit the other way round", "swap the columns x and y", lambda p: p[:, [1, 0, 2]])
MIRRORED_Y = Reading(
    "mirrored y",
    "y fits with the other sign, as in a left-handed frame",
    "change the sign of y",
    lambda p: p * [1.0, -1.0, 1.0],
)
MIRRORED = Reading(
    "mirrored",
    "the images fit mirrored",
    "write the other sense for camera.columns (or azimuth), or change the signs of y and theta if the frame is left-handed",
    mirrored=True,
)
FLIPPED = Reading("upside down", "the images fit upside down", "turn them, or swap camera.elevation_deg", flipped=True)
TURNED_OVER = Reading(
    "upside down",
    "the images fit turned by 180 degrees, upside down",
    "turn them",
    flipped=True,
    mirrored=True,
)


def heading_off(degrees: float) -> Reading:
    """The camera's heading column is so far off, degrees to the left."""
    return Reading(
        "heading off",
        f"the heading fits about {degrees:+.0f} degrees (left positive) from where camera.heading_column (or heading_angle_deg) has it",
        "correct it",
        bearing=math.radians(degrees),
    )


@dataclass(frozen=True)
class Fit:
    """A reading that fits far better than what is written.

    Parameters
    ----------
    reading : Reading
    agreement, written : float
        Mean agreement of the pairs by it, and by what is written.
    errors : float
        Their difference in its standard errors.
    pairs : int
    """

    reading: Reading
    agreement: float
    written: float
    errors: float
    pairs: int

    def line(self, where: str) -> str:
        """One line: where, what fits how well, and the remedy."""
        how = f"agreement {self.agreement:.2f} instead of {self.written:.2f} over {self.pairs} pairs of images"
        return f"{where}: {self.reading.said} ({how}); {self.reading.remedy}"


def best_fit(scores: Sequence[tuple[Reading, Float64]], least_gain: float = _LEAST_GAIN) -> Fit | None:
    """The reading that fits far better than the first one, what is written; None if none does.

    Parameters
    ----------
    scores : sequence of (Reading, float64 (pairs,))
        Agreement of the same pairs by each reading; of those that fit alike the first is meant.
    least_gain : float
        By how much a reading must agree better, as a share of its own agreement.
    """
    written = scores[0][1]
    if len(written) < _FEWEST_PAIRS:
        return None
    fits = []
    for reading, score in scores[1:]:
        gain = score - written
        error = float(gain.std(ddof=1)) / math.sqrt(len(gain))
        mean = float(score.mean())
        if mean >= _LEAST_AGREEMENT and gain.mean() > max(least_gain * mean, _LEAST_ERRORS * error):
            fits.append(Fit(reading, mean, float(written.mean()), float(gain.mean()) / max(error, 1e-9), len(gain)))
    if not fits:
        return None
    highest = max(fit.agreement for fit in fits)
    return next(fit for fit in fits if fit.agreement >= (1.0 - _AS_GOOD) * highest)

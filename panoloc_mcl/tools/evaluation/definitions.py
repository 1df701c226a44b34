"""The limits behind every figure, and how an error is compared with them.

A value that sits on a limit up to rounding counts as on it: it is *within* the limit, and neither under nor above it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import FloatArray

METRICS_SCHEMA = "panoloc-metrics/1"

STATUSES = ("searching", "converged", "ambiguous", "lost", "stale")

#: A robot knows where it is: errors under these, metres and degrees.
GOOD_POSITION_M = 0.5
GOOD_HEADING_DEG = 10.0

#: A robot is somewhere else: an error above one of these, metres and degrees.
BAD_POSITION_M = 1.0
BAD_HEADING_DEG = 20.0

#: How long a good stretch must last, and how long a bad one must last to be a lost track, seconds.
HOLD_S = 10.0
LOST_S = 3.0

#: Global success that the end of the data cuts short before ``HOLD_S`` must have lasted this long, seconds.
SUCCESS_TO_END_S = 3.0

#: A recovery that the end of the data cuts short before ``HOLD_S`` needs this many frames in a row.
MIN_FRAMES_TO_END = 3

#: A robot passes a place within this distance, metres.
PASS_RADIUS_M = 0.15

#: Name, metres and degrees of each tier.
WITHIN_TIERS = (
    ("0.10m_1deg", 0.10, 1.0),
    ("0.25m_2deg", 0.25, 2.0),
    ("0.50m_5deg", 0.50, 5.0),
    ("1.00m_10deg", 1.00, 10.0),
)

# Differences of coordinates and of stamps (up to 1e9 s) are only exact to about these.
ROUNDING = 1e-8
ROUNDING_S = 1e-6

BoolArray = NDArray[np.bool_]


def is_within(position_error_m: FloatArray, heading_error_deg: FloatArray, metres: float, degrees: float) -> BoolArray:
    """Frames whose errors are at most the given ones; shapes (n,)."""
    return (position_error_m <= metres + ROUNDING) & (heading_error_deg <= degrees + ROUNDING)


def is_good(position_error_m: FloatArray, heading_error_deg: FloatArray) -> BoolArray:
    """Frames with an error under 0.5 m and under 10°; shapes (n,)."""
    return (position_error_m < GOOD_POSITION_M - ROUNDING) & (heading_error_deg < GOOD_HEADING_DEG - ROUNDING)


def is_bad(position_error_m: FloatArray, heading_error_deg: FloatArray) -> BoolArray:
    """Frames with an error above 1.0 m or above 20°; shapes (n,)."""
    return (position_error_m > BAD_POSITION_M + ROUNDING) | (heading_error_deg > BAD_HEADING_DEG + ROUNDING)

"""Columns of an image in which a synthesised view shows the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.alignment import agreeing_columns

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

# Columns count where they agree, over a window around them, by this share of the upper quartile of all at the least.
_WINDOW_DEG, _SHARE = 21.0, 0.6


def agreeing(columns: Float64) -> Bool:
    """Columns where view and image show the same, as far as the best of them let expect: bool (columns,).

    Where the world is not a floor and a wall (a goal before a wall), or where somebody stands in front of it, the view is wrong, and
    its edges would pull the pose towards them. ``columns`` (3, columns) holds inner products and both squared norms.
    """
    reach = max(1, round(_WINDOW_DEG / 720.0 * columns.shape[1]))
    return agreeing_columns(columns, reach, _SHARE)

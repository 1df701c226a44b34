"""Which columns of an image agree with the view, and how far its bands of rows contradict each other about the pose.

Bands are the floor, and low and high parts of the walls. A camera that is not as it is described displaces the floor otherwise than the
walls: its centre is off, or its elevations are. All sectors of the circle and all views are displaced alike then, so their scatter does
not show it. The pose to which each band would go alone does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.alignment import agreeing_columns, normal_equations

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

# Columns count where they agree, over a window around them, by this share of the upper quartile of all at the least.
_WINDOW_DEG, _SHARE = 21.0, 0.6
# A band with less than this share of the information of the strongest says nothing.
_LEAST_SHARE = 1e-3
_REGULAR = 1e-6


def agreeing(columns: Float64) -> Bool:
    """Columns where view and image show the same, as far as the best of them let expect: bool (columns,).

    Where the world is not a floor and a wall (a goal before a wall), or where somebody stands in front of it, the view is wrong, and
    its edges would pull the pose towards them. ``columns`` (3, columns) holds inner products and both squared norms.
    """
    reach = max(1, round(_WINDOW_DEG / 720.0 * columns.shape[1]))
    return agreeing_columns(columns, reach, _SHARE)


class Banded(NamedTuple):
    """What the equations of one view are made of, by bands.

    Parameters
    ----------
    weight : float
    products : list of float64 (24, columns)
        Of every band (see `column_products`).
    chosen : bool (columns,)
    """

    weight: float
    products: list[Float64]
    chosen: Bool


def contradiction(banded: Sequence[Banded], row_step: float, variance: float) -> float:
    """Mean squared difference of the poses that bands ask for, in variances that noise of the pixels gives: 1 where it is noise alone.

    Parameters
    ----------
    banded : sequence of Banded
        Of all views at a pose; the tilt is taken as it was found there.
    row_step : float
        Elevation of a row, radians.
    variance : float
        Mean squared difference of a pixel, with what neighbouring pixels have in common counted in.

    Returns
    -------
    float
        0 where fewer than two bands say anything.
    """
    count = len(banded[0].products) if banded else 0
    normals, rights = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for view in banded:
        for band, products in enumerate(view.products):
            normal, right, _, _ = normal_equations(products, view.chosen, row_step)
            normals[band] += view.weight * normal[:3, :3]
            rights[band] += view.weight * right[:3]
    strength = np.trace(normals, axis1=1, axis2=2)
    says = strength > _LEAST_SHARE * strength.max(initial=0.0)
    if np.count_nonzero(says) < 2:
        return 0.0
    information = normals[says] + _REGULAR * strength[says, None, None] * np.eye(3)
    alone = np.linalg.solve(information, rights[says, :, None])[:, :, 0]
    together = np.linalg.solve(information.sum(axis=0), np.einsum("bij,bj->i", information, alone))
    apart = alone - together
    return float(np.einsum("bi,bij,bj->", apart, information, apart)) / (variance * 3.0 * (len(alone) - 1))

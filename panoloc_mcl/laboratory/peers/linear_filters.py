"""Linear filters that answer with the slope in three directions 60 degrees apart: the paper's, and steerable ones of any width.

The paper says "a bank of 3 gradient filters with a 3x3 filter kernel instead of the recommended steerable filters" without giving
either. Here: first derivatives by Sobel's kernels, or of a Gaussian (G1 of Freeman & Adelson, "The design and use of steerable
filters", TPAMI 1991), steered to 0, 60 and 120 degrees; a first derivative steers exactly from two.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

Filters = Literal["gradients", "steerable"]

_SOBEL_X = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]], dtype=np.float32) / 8.0
DIRECTIONS_DEG = (0.0, 60.0, 120.0)
GRADIENT_FILTERS: tuple[Float32, ...] = tuple(
    (np.cos(np.radians(angle)) * _SOBEL_X + np.sin(np.radians(angle)) * _SOBEL_X.T).astype(np.float32)
    for angle in DIRECTIONS_DEG
)


def filter_bank(image: Float32) -> Float32:
    """Responses of the three gradient filters, circular across the seam, replicated at the upper and lower rim.

    Parameters
    ----------
    image : float32 (rows, columns)

    Returns
    -------
    float32 (3, rows, columns)
    """
    return _responses(image, GRADIENT_FILTERS)


def filter_size(filters: Filters, width_px: float) -> int:
    """Rows and columns of a filter kernel; a Gaussian is cut at 3 sigma."""
    return 3 if filters == "gradients" else 2 * max(1, int(np.ceil(3.0 * width_px))) + 1


def basis_responses(image: Float32, filters: Filters, width_px: float = 1.0) -> Float32:
    """Two responses that stand for the bank of three.

    The three responses of a bank are g_x cos a + g_y sin a for a = 0, 60, 120 degrees, and the sum of their squares is
    1.5 (g_x^2 + g_y^2). So sqrt(1.5) (g_x, g_y) has the same sums of squares and of products: least squares, its residual at
    a pixel and what is trimmed are those of the bank, from two thirds of the numbers.

    Parameters
    ----------
    image : float32 (rows, columns)
    filters : str
        ``gradients`` (3x3) or ``steerable`` (derivatives of a Gaussian).
    width_px : float
        Standard deviation of that Gaussian, pixels.

    Returns
    -------
    float32 (2, rows, columns)
        Circular across the seam, replicated at the upper and lower rim.
    """
    along = _SOBEL_X if filters == "gradients" else gaussian_derivative(width_px)
    scale = np.float32(np.sqrt(len(DIRECTIONS_DEG) / 2.0))
    return _responses(image, (scale * along, scale * along.T))


def gaussian_derivative(width_px: float) -> Float32:
    """Derivative of a Gaussian along the columns, as a correlation kernel that answers a slope of 1 with 1.

    Parameters
    ----------
    width_px : float
        Standard deviation, pixels.

    Returns
    -------
    float32 (size, size)
        Size as `filter_size` says.
    """
    reach = filter_size("steerable", width_px) // 2
    offsets = np.arange(-reach, reach + 1, dtype=np.float64)
    bell = np.exp(-0.5 * np.square(offsets / width_px))
    slope = offsets * bell
    return np.outer(bell / bell.sum(), slope / (slope * offsets).sum()).astype(np.float32)


def _responses(image: Float32, kernels: tuple[Float32, ...]) -> Float32:
    reach = kernels[0].shape[0] // 2
    padded = np.pad(image, ((0, 0), (reach, reach)), mode="wrap")
    return np.stack(
        [
            cv2.filter2D(padded, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)[:, reach : reach + image.shape[1]]
            for kernel in kernels
        ]
    )

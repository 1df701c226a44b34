"""The paper's linear gradient filters: three 3x3 kernels in directions 60 degrees apart.

The paper says "a bank of 3 gradient filters with a 3x3 filter kernel" without giving them. Here: first derivatives by Sobel's
kernels, steered to 0, 60 and 120 degrees (a first derivative steers exactly from two: Freeman & Adelson 1991).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

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
    padded = np.pad(image, ((0, 0), (1, 1)), mode="wrap")
    return np.stack(
        [cv2.filter2D(padded, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)[:, 1:-1] for kernel in GRADIENT_FILTERS]
    )

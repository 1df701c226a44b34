"""Features of an image as planes that can be smoothed and warped."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.eigenspace.gradients import orientations, pad_circular
from panoloc_mcl.robot.kernels.warping import features_of_planes
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.views import MARGIN

Float32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]


def source_planes(references: ReferencePanoramas, settings: VotesSettings, source: int, sigma: float) -> Float32:
    """Planes of a reference (see `planes_of`)."""
    return planes_of(*orientations(references.panorama(source), settings), sigma)


def planes_of(z: Complex64, usable: Bool, sigma: float) -> Float32:
    """Real part, imaginary part, usability and nothing, smoothed and continued across the seam: (rows, columns + 2 MARGIN, 4)."""
    # Two boxes of n pixels have the variance (n^2 - 1) / 6; they take the same time for any n.
    box = 2 * round(0.5 * (np.sqrt(6.0 * sigma**2 + 1.0) - 1.0)) + 1
    margin = MARGIN + box
    planes = np.empty((z.shape[0], z.shape[1] + 2 * margin, 4), dtype=np.float32)
    planes[..., 0] = pad_circular(z.real, margin)
    planes[..., 1] = pad_circular(z.imag, margin)
    planes[..., 2] = pad_circular(usable, margin)
    planes[..., 3] = 0.0
    if box > 1:
        smooth = cv2.blur(cv2.blur(planes, (box, box)), (box, box))
        # A pixel is as usable as it was; only what is compared is smoothed.
        smooth[..., 2] = planes[..., 2]
        planes = smooth
    return np.ascontiguousarray(planes[:, box : planes.shape[1] - box])


def read_planes(planes: Float32, map_x: Float32, map_y: Float32) -> tuple[Complex64, Bool]:
    """Features (rows, columns) of planes where tables (rows, columns) point into them, and which are usable."""
    return features_of_planes(cv2.remap(planes, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT))

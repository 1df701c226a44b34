"""What can go wrong with a panorama: focus, tilt and noise, beside the disturbances that maps are calibrated with.

Every function takes an 8-bit image of shape (rows, columns) or (rows, columns, channels), a generator and severities, and gives a
new image of the same shape. Columns are a circle: nothing shows a seam between the last and the first. All channels of a pixel
suffer alike, but for noise. The severity that changes nothing (a share, sigma or angle of 0, a gain of 1; for `spatial_light` a
``log_sd`` of 0 with a gain of 1 and a ``full_well`` of 0) returns an equal image.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from panoloc_mcl.robot.observation.disturbances import Image, bars, blobs, gain, random_pixels, spatial_light, to_8_bits

__all__ = ["bars", "blobs", "blur", "gain", "noise", "random_pixels", "spatial_light", "tilt"]


def blur(image: Image, rng: np.random.Generator, sigma: float) -> Image:
    """Out of focus: a Gaussian over rows and columns (``rng`` is not used).

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    sigma : float
        Standard deviation, pixels.
    """
    if sigma == 0.0:
        return image.copy()
    # Never over the channels.
    return to_8_bits(gaussian_filter(image.astype(np.float64), sigma, mode=("nearest", "wrap"), axes=(0, 1)))


def tilt(image: Image, rng: np.random.Generator, degrees: float, vertical_field_deg: float) -> Image:
    """A camera that leans in a random direction: rows move up and down sinusoidally with azimuth.

    To first order that is all a small tilt does; the shift along the columns, smaller by the tangent of the elevation, is left out.
    Rows that come in from beyond the image repeat its rim.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    degrees : float
        Angle of the tilt, which is the largest shift.
    vertical_field_deg : float
        Elevations that the rows cover, degrees.
    """
    if degrees == 0.0:
        return image.copy()
    rows, columns = image.shape[:2]
    direction = rng.uniform(0.0, 2.0 * np.pi)
    shift = degrees * rows / vertical_field_deg * np.cos(2.0 * np.pi * np.arange(columns) / columns - direction)
    from_row = (np.arange(rows)[:, None] + shift).astype(np.float32)
    from_column = np.broadcast_to(np.arange(columns, dtype=np.float32), (rows, columns))
    moved = cv2.remap(image, np.ascontiguousarray(from_column), from_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.uint8).reshape(image.shape)


def noise(image: Image, rng: np.random.Generator, sd: float) -> Image:
    """Gaussian noise of every pixel and channel.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    sd : float
        Standard deviation, grey levels.
    """
    return to_8_bits(image + rng.normal(0.0, sd, image.shape))

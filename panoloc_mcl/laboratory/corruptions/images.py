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
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.observation.disturbances import Image, bars, blobs, gain, random_pixels, spatial_light, to_8_bits

__all__ = ["bars", "blobs", "blur", "gain", "lean", "noise", "random_pixels", "spatial_light", "tilt"]


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


def tilt(image: Image, rng: np.random.Generator, degrees: float, elevation_deg: tuple[float, float]) -> Image:
    """A camera that leans in a random direction (see `lean`).

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    degrees : float
        Angle between the camera's axis and the vertical.
    elevation_deg : (float, float)
        Elevation of the lower edge of the bottom row and of the upper edge of the top row, degrees.
    """
    direction = rng.uniform(0.0, 2.0 * np.pi)
    return lean(image, rng, degrees * np.cos(direction), degrees * np.sin(direction), elevation_deg)


def lean(
    image: Image, rng: np.random.Generator, pitch_deg: float, roll_deg: float, elevation_deg: tuple[float, float]
) -> Image:
    """A camera that is mounted askew: every ray is turned, exactly (``rng`` is not used).

    Rows that come in from beyond the image repeat its rim.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
        Columns clockwise, the first one along the robot's heading.
    rng : Generator
    pitch_deg, roll_deg : float
        Rotation vector of the camera about the robot's y axis (positive: nose down) and x axis (positive: right side down), degrees.
    elevation_deg : (float, float)
        As in `tilt`.
    """
    if pitch_deg == 0.0 and roll_deg == 0.0:
        return image.copy()
    rows, columns = image.shape[:2]
    bottom, top = np.radians(elevation_deg)
    row_step, column_step = (top - bottom) / rows, 2.0 * np.pi / columns
    elevation, azimuth = np.meshgrid(top - (np.arange(rows) + 0.5) * row_step, -column_step * np.arange(columns), indexing="ij")
    rays = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)
    turned = Rotation.from_rotvec([roll_deg, pitch_deg, 0.0], degrees=True).apply(rays.reshape(-1, 3)).reshape(rays.shape)
    from_column = np.mod(-np.arctan2(turned[..., 1], turned[..., 0]), 2.0 * np.pi) / column_step
    from_row = (top - np.arcsin(np.clip(turned[..., 2], -1.0, 1.0))) / row_step - 0.5
    # One more column on the right: those between the last and the first lie across the seam.
    closed = np.concatenate([image, image[:, :1]], axis=1)
    moved = cv2.remap(
        closed, from_column.astype(np.float32), from_row.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
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

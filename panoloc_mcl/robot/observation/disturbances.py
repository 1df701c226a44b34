"""Disturbances that a map is calibrated with: noise, occlusion and light.

Every function takes an 8-bit image of shape (rows, columns) or (rows, columns, channels), a generator and severities, and gives a
new image of the same shape. Columns are a circle: nothing shows a seam between the last and the first. All channels of a pixel
suffer alike, but for noise. The severity that changes nothing (a share, sigma or angle of 0, a gain of 1; for `spatial_light` a
``log_sd`` of 0 with a gain of 1 and a ``full_well`` of 0) returns an equal image.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Image = NDArray[np.uint8]
Float64 = NDArray[np.float64]


def random_pixels(image: Image, rng: np.random.Generator, share: float) -> Image:
    """Replace a share of the pixels by random ones, as in section 4 of the paper.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    share : float
        Of the pixels, in [0, 1]; rounded to whole pixels, each of which gets another value than it had.
    """
    corrupted = image.copy()
    pixels = corrupted.reshape(image.shape[0] * image.shape[1], -1)
    chosen = rng.permutation(len(pixels))[: round(share * len(pixels))]
    # Adding 1 to 255 modulo 256 reaches every value but the old one, all with the same chance.
    pixels[chosen] += rng.integers(1, 256, (len(chosen), pixels.shape[1]), dtype=np.uint8)
    return corrupted


def bars(image: Image, rng: np.random.Generator, share: float, count: int = 4) -> Image:
    """Black vertical bars, as in section 4 of the paper.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    share : float
        Of the columns that the bars cover together, in [0, 1]; rounded to whole columns.
    count : int
        Bars, of random widths and at random distances; fewer where the columns do not suffice to keep them apart.
    """
    columns = image.shape[1]
    covered = round(share * columns)
    corrupted = image.copy()
    count = min(count, covered, max(columns - covered, 1))
    if count > 0:
        widths, gaps = _parts(covered, count, rng), _parts(columns - covered, count, rng)
        black = np.repeat(np.tile([True, False], count), np.stack([widths, gaps], axis=1).ravel())
        corrupted[:, np.roll(black, rng.integers(columns))] = 0
    return corrupted


def blobs(image: Image, rng: np.random.Generator, share: float, size_deg: float = 10.0) -> Image:
    """Plain grey blobs in front of the scene, such as things that were not there when the map was made.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    share : float
        Of the pixels that the blobs cover together, in [0, 1]; rounded to whole pixels.
    size_deg : float
        Their scale (correlation length of the random field whose highest parts they are), degrees of azimuth.
    """
    rows, columns = image.shape[:2]
    field = _smooth_field(rows, columns, size_deg, rng).ravel()
    level = rng.integers(32, 224, dtype=np.uint8)
    corrupted = image.copy()
    covered = np.argsort(field)[rows * columns - round(share * rows * columns) :]
    corrupted.reshape(rows * columns, -1)[covered] = level
    return corrupted


def gain(image: Image, rng: np.random.Generator, factor: float) -> Image:
    """Another exposure: all grey levels times ``factor``, saturated at 255 (``rng`` is not used).

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    factor : float
        At least 0.
    """
    return to_8_bits(image * np.float64(factor))


def spatial_light(
    image: Image,
    rng: np.random.Generator,
    log_sd: float = 0.6,
    gain: float = 0.12,
    scale_deg: float = 30.0,
    full_well: float = 10_000.0,
    read_noise: float = 8.0,
) -> Image:
    """Light that varies over the room: the image times the exponential of a smooth random field, seen by a noisy 8-bit camera.

    Parameters
    ----------
    image : uint8 (rows, columns) or (rows, columns, channels)
    rng : Generator
    log_sd : float
        Standard deviation of the logarithm of the light over the image.
    gain : float
        Factor on all of it: how much darker the room is.
    scale_deg : float
        Correlation length of the light, degrees of azimuth.
    full_well : float
        Electrons of a pixel at grey level 255, which set the shot noise; 0 = none.
    read_noise : float
        Standard deviation, electrons; without effect where there is no ``full_well``.
    """
    rows, columns = image.shape[:2]
    light = gain * np.exp(log_sd * _smooth_field(rows, columns, scale_deg, rng))
    levels = image * light.reshape(light.shape + (1,) * (image.ndim - 2))
    if full_well > 0.0:
        # The sensor saturates before anything is counted.
        electrons = np.minimum(levels, 255.0) * (full_well / 255.0)
        counted = rng.poisson(electrons) + rng.normal(0.0, read_noise, electrons.shape)
        levels = counted * (255.0 / full_well)
    return to_8_bits(levels)


def to_8_bits(levels: Float64) -> Image:
    """Grey levels rounded and held within 0 to 255."""
    return np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8)


def _parts(total: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Random whole numbers, each at least 1, that add up to ``total``; just that for a ``count`` of 1."""
    if count == 1:
        return np.array([total], dtype=np.int64)
    cuts = np.sort(rng.permutation(total - 1)[: count - 1]) + 1
    edges = np.concatenate([[0], cuts, [total]]).astype(np.int64)
    return edges[1:] - edges[:-1]


def _smooth_field(rows: int, columns: int, scale_deg: float, rng: np.random.Generator) -> Float64:
    """A random field, smooth over the scale and across the seam, of mean 0 and standard deviation 1."""
    white = rng.standard_normal((rows, columns))
    sigma = scale_deg * columns / 360.0
    field = gaussian_filter(white, sigma, mode=("reflect", "wrap"))
    field -= field.mean()
    spread = float(field.std())
    return np.asarray(field / spread if spread > 0.0 else field)

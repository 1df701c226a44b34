"""Procedural pictures of materials: arrays of albedo (0..1), row 0 at the bottom, ``TEXELS_PER_M`` texels a metre."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Texture = NDArray[np.float32]

TEXELS_PER_M = 50


def blank(width_m: float, height_m: float, albedo: float) -> Texture:
    """An even surface of at least one texel."""
    shape = (max(1, round(height_m * TEXELS_PER_M)), max(1, round(width_m * TEXELS_PER_M)))
    return np.full(shape, albedo, dtype=np.float32)


def clouds(rng: np.random.Generator, texture: Texture, cell_m: float, strength: float) -> Texture:
    """Smooth random stains of about ``cell_m`` in size, multiplied onto a texture."""
    height, width = texture.shape
    cells = [max(2, round(n / (cell_m * TEXELS_PER_M)) + 1) for n in (height, width)]
    coarse = rng.normal(0.0, 1.0, cells).astype(np.float32)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(texture * (1.0 + strength * smooth), 0.02, 0.95), dtype=np.float32)


def grained(rng: np.random.Generator, texture: Texture, strength: float) -> Texture:
    """Stains of three sizes, as on any real surface."""
    for cell_m, share in ((0.6, 0.5), (0.15, 0.3), (0.04, 0.4)):
        texture = clouds(rng, texture, cell_m, strength * share)
    return texture


def tiles(rng: np.random.Generator, width_m: float, height_m: float, tile_m: tuple[float, float], albedo: float) -> Texture:
    """Tiles or bricks in running bond, each of its own shade, with dark joints."""
    texture = blank(width_m, height_m, albedo)
    rows, columns = np.indices(texture.shape) / TEXELS_PER_M
    row = np.floor(rows / tile_m[1]).astype(int)
    along = columns / tile_m[0] + 0.5 * (row % 2)
    column = np.floor(along).astype(int)
    shades = rng.normal(1.0, 0.13, (row.max() + 1, column.max() + 1)).astype(np.float32)
    texture *= shades[row, column]
    joint = ((along - column) * tile_m[0] < 0.025) | (rows - row * tile_m[1] < 0.025)
    texture[joint] *= 0.55
    return grained(rng, texture, 0.10)


def stripes(width_m: float, height_m: float, period_m: float, dark: float, light: float, upright: bool) -> Texture:
    """Even stripes."""
    texture = blank(width_m, height_m, light)
    along = np.indices(texture.shape)[1 if upright else 0] / TEXELS_PER_M
    texture[(along % period_m) < 0.5 * period_m] = dark
    return texture


def checker(width_m: float, height_m: float, cell_m: float, dark: float, light: float) -> Texture:
    """A chess board."""
    texture = blank(width_m, height_m, light)
    rows, columns = np.floor(np.indices(texture.shape) / (TEXELS_PER_M * cell_m)).astype(int)
    texture[(rows + columns) % 2 == 0] = dark
    return texture


def books(rng: np.random.Generator, width_m: float, height_m: float, shelf_m: float) -> Texture:
    """Shelf boards with rows of books of random width, height and shade."""
    texture = blank(width_m, height_m, 0.08)
    height, width = texture.shape
    shelf = max(4, round(shelf_m * TEXELS_PER_M))
    for bottom in range(0, height, shelf):
        column = 1
        while column < width - 1:
            thickness = int(rng.integers(1, 5))
            top = bottom + 2 + int(rng.uniform(0.55, 0.9) * (shelf - 3))
            texture[bottom + 2 : min(top, height), column : min(column + thickness, width - 1)] = rng.uniform(0.08, 0.8)
            column += thickness + (int(rng.integers(3, 12)) if rng.random() < 0.07 else 0)
        texture[bottom : bottom + 2] = 0.45
    texture[:, :1] = texture[:, -1:] = 0.45
    return texture


def drawers(rng: np.random.Generator, width_m: float, height_m: float, fronts: tuple[int, int], albedo: float) -> Texture:
    """Cupboard fronts (columns, rows) with gaps and handles."""
    texture = grained(rng, blank(width_m, height_m, albedo), 0.12)
    height, width = texture.shape
    for column in range(fronts[0]):
        for row in range(fronts[1]):
            left, right = (round(width * (column + k) / fronts[0]) for k in (0, 1))
            low, high = (round(height * (row + k) / fronts[1]) for k in (0, 1))
            texture[low : low + 1, left:right] = texture[low:high, left : left + 1] = 0.05
            middle = (left + right) // 2
            texture[high - 4 : high - 2, max(left, middle - 4) : middle + 4] = 0.8
    return texture


def poster(rng: np.random.Generator, width_m: float, height_m: float) -> Texture:
    """A picture with a white frame: discs, bars and blots of random shade."""
    texture = blank(width_m, height_m, float(rng.uniform(0.1, 0.7)))
    height, width = texture.shape
    for _ in range(int(rng.integers(5, 11))):
        shade = float(rng.uniform(0.03, 0.9))
        x, y = int(rng.integers(0, width)), int(rng.integers(0, height))
        size = int(rng.integers(3, max(4, min(width, height) // 2)))
        if rng.random() < 0.5:
            cv2.circle(texture, (x, y), size, shade, -1)
        else:
            cv2.rectangle(texture, (x, y), (x + 2 * size, y + max(2, size // 2)), shade, -1)
    texture[:2] = texture[-2:] = 0.88
    texture[:, :2] = texture[:, -2:] = 0.88
    return texture


def text_page(rng: np.random.Generator, width_m: float, height_m: float) -> Texture:
    """A white board with lines of dark scribble."""
    texture = blank(width_m, height_m, 0.85)
    height, width = texture.shape
    for row in range(4, height - 4, 5):
        for column in range(3, int(width * rng.uniform(0.5, 0.95)), 3):
            if rng.random() < 0.7:
                texture[row : row + int(rng.integers(1, 4)), column : column + 2] = 0.1
    texture[:1] = texture[-1:] = 0.3
    texture[:, :1] = texture[:, -1:] = 0.3
    return texture


def paste(texture: Texture, picture: Texture, left_m: float, bottom_m: float) -> None:
    """Put a picture onto a texture, in place; what does not fit is cut off."""
    row, column = round(bottom_m * TEXELS_PER_M), round(left_m * TEXELS_PER_M)
    target = texture[row : row + picture.shape[0], column : column + picture.shape[1]]
    target[...] = picture[: target.shape[0], : target.shape[1]]

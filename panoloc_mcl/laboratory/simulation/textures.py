"""Patterns of surfaces, drawn by formula: the same for the same seed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.scene import Material

FloatArray = NDArray[np.float64]
Texture = NDArray[np.float32]

_WORDS = ("EXIT", "HALL B", "ROBOTS", "TEAM 7", "FIELD 2", "NO ENTRY", "LAB", "INFO", "WORKSHOP", "STAGE")


def texture_of(material: Material, width_m: float, height_m: float, at: tuple[float, float], seed: int) -> Texture:
    """Albedo of a rectangle, first row at the bottom.

    Parameters
    ----------
    material : Material
    width_m, height_m : float
    at : (float, float)
        Metres along and up where the rectangle begins, so that neighbours continue each other's bricks.
    seed : int

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        1 x 1 where nothing is drawn.
    """
    if material.pattern in ("plain", "field"):
        return np.full((1, 1), material.albedo, dtype=np.float32)
    density = 30.0 if width_m * height_m > 30.0 else 60.0 if width_m * height_m > 4.0 else 100.0
    shape = (max(2, round(height_m * density)), max(2, round(width_m * density)))
    t, s = np.meshgrid(
        (np.arange(shape[0]) + 0.5) / shape[0] * height_m, (np.arange(shape[1]) + 0.5) / shape[1] * width_m, indexing="ij"
    )
    rng = np.random.default_rng([seed, 77])
    factor = _PATTERNS[material.pattern](s, t, at, material.scale_m, rng)
    albedo = material.albedo * (1.0 + material.contrast * factor)
    return np.clip(albedo, 0.01, 0.95).astype(np.float32)


def _noise(shape: tuple[int, int], cells: float, rng: np.random.Generator) -> FloatArray:
    coarse = rng.uniform(-1.0, 1.0, (max(2, int(shape[0] / cells)), max(2, int(shape[1] / cells)))).astype(np.float32)
    return np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_LINEAR), dtype=np.float64)


def _speckle(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    return 0.4 * rng.standard_normal(s.shape) + 0.5 * _noise(s.shape, 60.0, rng)


def _grid_of(s: FloatArray, t: FloatArray, at: tuple[float, float], wide: float, high: float, shifted: bool) -> FloatArray:
    row = np.floor((t + at[1]) / high)
    along = (s + at[0]) / wide + (0.5 * (row % 2) if shifted else 0.0)
    column = np.floor(along)
    # A hash, so that a stone looks the same in whichever rectangle it lies.
    shade = np.mod(np.sin(row * 12.9898 + column * 78.233) * 43758.5453, 1.0) - 0.5
    joint = (np.abs(along - column - 0.5) > 0.5 - 0.012 / wide) | (np.abs((t + at[1]) / high - row - 0.5) > 0.5 - 0.012 / high)
    return np.where(joint, -0.9, 0.7 * shade)


def _tiles(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    return _grid_of(s, t, at, scale, scale, False)


def _bricks(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    return _grid_of(s, t, at, scale, 0.4 * scale, True)


def _boards(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    return _grid_of(s, t, at, scale, 4.0, False)


def _stripes(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    return np.sign(np.sin(2.0 * np.pi * (s + t + at[0] + at[1]) / scale))


def _books(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    picture = np.full(s.shape, -0.95)
    rows, columns = s.shape
    column = 0
    while column < columns:
        width = max(1, round(rng.uniform(0.015, 0.07) / (s[0, -1] + 1e-9) * columns))
        if rng.random() < 0.88:
            picture[: round(rows * rng.uniform(0.55, 0.95)), column : column + width] = rng.uniform(-0.8, 1.0)
        column += width
    return picture


def _poster(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    rows, columns = s.shape
    picture = np.full(s.shape, rng.uniform(0.3, 0.9), dtype=np.float32)
    for _ in range(int(rng.integers(4, 10))):
        shade = float(rng.uniform(-1.0, 0.9))
        x, y = (int(rng.integers(0, n)) for n in (columns, rows))
        wide, high = (max(2, int(n * rng.uniform(0.1, 0.45))) for n in (columns, rows))
        if rng.random() < 0.35:
            cv2.ellipse(picture, (x, y), (wide // 2, high // 2), float(rng.uniform(0, 180)), 0, 360, shade, -1)
        else:
            cv2.rectangle(picture, (x, y), (x + wide, y + high), shade, -1)
    for line in range(int(rng.integers(3, 7))):
        y = int(rows * (0.06 + 0.035 * line))
        cv2.line(picture, (columns // 8, y), (int(columns * rng.uniform(0.5, 0.9)), y), -0.9, max(1, rows // 80))
    _write(picture, _WORDS[int(rng.integers(len(_WORDS)))], 0.85, -0.95)
    return picture.astype(np.float64)


def _text(s: FloatArray, t: FloatArray, at: tuple[float, float], scale: float, rng: np.random.Generator) -> FloatArray:
    picture = np.full(s.shape, -0.6, dtype=np.float32)
    _write(picture, "  ".join(rng.permutation(_WORDS)[:2]), 0.5, 1.0, 0.6)
    return picture.astype(np.float64)


def _write(picture: NDArray[np.float32], words: str, height: float, shade: float, size: float = 0.12) -> None:
    """Letters, upright although the first row is at the bottom."""
    rows, columns = picture.shape
    mask = np.zeros((rows, columns), dtype=np.uint8)
    (wide, high), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)
    scale = min(0.85 * columns / wide, size * rows / high)
    left, base = int(0.5 * (columns - scale * wide)), int(rows * (1.0 - height) + 0.5 * scale * high)
    cv2.putText(mask, words, (left, base), cv2.FONT_HERSHEY_DUPLEX, scale, 255, max(1, round(2 * scale)), cv2.LINE_AA)
    ink = mask[::-1].astype(np.float32) / 255.0
    picture += ink * (shade - picture)


_PATTERNS = {
    "speckle": _speckle,
    "tiles": _tiles,
    "bricks": _bricks,
    "boards": _boards,
    "stripes": _stripes,
    "books": _books,
    "poster": _poster,
    "text": _text,
}


def field_texture(material: Material, width_m: float, height_m: float, lines: tuple[float, float, float, float]) -> Texture:
    """A green carpet with the white lines of a middle-size field of 2004.

    Parameters
    ----------
    material : Material
        Of the carpet.
    width_m, height_m : float
        Of the carpet; first row at its low edge.
    lines : (float, float, float, float)
        Left, low, right and high border lines, metres from the carpet's corner; goals stand on the low and the high one.
    """
    density = 80.0
    shape = (round(height_m * density), round(width_m * density))
    rng = np.random.default_rng(4)
    carpet = material.albedo * (1.0 + 0.25 * _noise(shape, 90.0, rng) + 0.18 * rng.standard_normal(shape))
    mask = np.zeros((shape[0] * 2, shape[1] * 2), dtype=np.uint8)

    def px(x: float, y: float) -> tuple[int, int]:
        return round(x * density * 2), round(y * density * 2)

    left, low, right, high = lines
    middle, centre = 0.5 * (low + high), 0.5 * (left + right)
    thick = round(0.06 * density * 2)
    cv2.rectangle(mask, px(left, low), px(right, high), 255, thick)
    cv2.line(mask, px(left, middle), px(right, middle), 255, thick)
    cv2.circle(mask, px(centre, middle), round(1.0 * density * 2), 255, thick)
    for edge, inwards in ((low, 1.0), (high, -1.0)):
        cv2.rectangle(mask, px(centre - 1.5, edge), px(centre + 1.5, edge + inwards * 0.6), 255, thick)
    share = cv2.resize(mask, shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float64) / 255.0
    return np.asarray(np.clip(carpet * (1.0 - share) + 0.82 * share, 0.01, 0.95), dtype=np.float32)

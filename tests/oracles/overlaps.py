"""Norms over the overlap of two images, with loops."""

import numpy as np


def blocks(image, rows, columns):
    """Sums over rows x columns blocks, as even as whole pixels allow."""
    edges = [[size * k // count for k in range(count + 1)] for size, count in zip(image.shape, (rows, columns), strict=True)]
    out = np.zeros((rows, columns))
    for i in range(rows):
        for k in range(columns):
            out[i, k] = image[edges[0][i] : edges[0][i + 1], edges[1][k] : edges[1][k + 1]].sum()
    return out


def by_blocks(energy, share, places_energy, places_share):
    """Products of both norms for turns by whole blocks, (block columns, k), from the sums over blocks."""
    count = energy.shape[1]
    out = np.zeros((count, len(places_energy)))
    for turn in range(count):
        for k in range(len(places_energy)):
            mine = (np.roll(energy, -turn, axis=1) * places_share[k]).sum()
            theirs = (np.roll(share, -turn, axis=1) * places_energy[k]).sum()
            out[turn, k] = np.sqrt(max(mine, 0.01 * energy.sum()) * max(theirs, 0.01 * places_energy[k].sum()))
    return out


def by_pixels(z, usable, places_z, places_usable):
    """The same for every column, pixel by pixel, (columns, k)."""
    out = np.zeros((z.shape[1], len(places_z)))
    for turn in range(z.shape[1]):
        back, back_usable = np.roll(z, -turn, axis=1), np.roll(usable, -turn, axis=1)
        for k, (place, place_usable) in enumerate(zip(places_z, places_usable, strict=True)):
            out[turn, k] = np.linalg.norm(back[place_usable]) * np.linalg.norm(place[back_usable])
    return out


def between_blocks(norms: np.ndarray, columns: int) -> np.ndarray:
    """Norms at turns by whole blocks (blocks, k) -> at turns by every column (columns, k), linear in between, around the circle."""
    blocks = len(norms)
    at, closed = np.arange(columns) * blocks / columns, np.vstack([norms, norms[:1]])
    return np.stack([np.interp(at, np.arange(blocks + 1), of_place) for of_place in closed.T], axis=1)

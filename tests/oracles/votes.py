"""Brute force: the image is rolled for every heading and compared with every place pixel by pixel."""

import numpy as np


def masked_cosines(z, usable, places_z, places_usable):
    """Cosine of the image turned back by every whole column with every place, over the pixels that both can use.

    Returns (headings, k).
    """
    columns = z.shape[1]
    out = np.zeros((columns, len(places_z)))
    for heading in range(columns):
        back, back_usable = np.roll(z, -heading, axis=1), np.roll(usable, -heading, axis=1)
        for k, (place, place_usable) in enumerate(zip(places_z, places_usable, strict=True)):
            mine = (np.abs(back[place_usable]) ** 2).sum()
            theirs = (np.abs(place[back_usable]) ** 2).sum()
            out[heading, k] = np.real(np.vdot(place, back)) / np.sqrt(mine * theirs)
    return out


def voted(cosines, width):
    angle = np.arccos(np.clip(cosines, 0.0, 1.0))
    return np.exp(-(angle**2) / (2.0 * width**2))


def shepard(positions, at, neighbours, radius_scale, reach):
    """Weights of places at one point (Franke & Little), written for one point at a time; zeros off the map."""
    distances = np.hypot(*(positions - at).T)
    weights = np.zeros(len(positions))
    if distances.min() > reach:
        return weights
    order = np.argsort(distances, kind="stable")
    used = order[:neighbours]
    radius = distances[order[neighbours]] if len(positions) > neighbours else radius_scale * max(distances.max(), reach)
    for place in used:
        weights[place] = max(radius - distances[place], 0.0) / (radius * max(distances[place], 1e-6))
    if weights.sum() == 0.0:
        weights[used] = 1.0
    return weights / weights.sum()

"""A map with virtual places in plain NumPy, with OpenCV's filters and remap: depths, views, eigenspace. Whole arrays, no kernels."""

import cv2
import numpy as np
from oracles import warping

MARGIN, NEAR_M, BASIS_IMAGES, SMOOTHING_DEG = 4, 0.05, 300, 9.0


def features(pixels, valid, settings):
    """Normalised gradients, complex128, and where they are usable."""
    columns = pixels.shape[1]
    reach = int(np.ceil(3.0 * settings.smoothing_px))
    margin = reach + 2
    grey = np.pad(pixels.astype(np.float32), ((0, 0), (margin, margin)), mode="wrap")
    if settings.median:
        grey = cv2.medianBlur(grey, 3)
    bad = (grey <= settings.mask_dark) | (grey >= settings.mask_bright)
    if valid is not None:
        bad |= np.pad(~valid, ((0, 0), (margin, margin)), mode="wrap")
    if settings.smoothing_px > 0.0:
        grey = cv2.GaussianBlur(grey, (2 * reach + 1, 2 * reach + 1), settings.smoothing_px)
    spread = 3 + 2 * round(settings.smoothing_px)
    bad = cv2.dilate(bad.astype(np.uint8), np.ones((spread, spread), np.uint8))
    z = warping.normalised_gradients(grey, bad, margin, settings.contrast_floor, settings.gradient == "doubled_angle")
    usable = bad[:, margin : margin + columns] == 0
    usable[[0, -1]] = False
    return z, usable


class Warper:
    """Views of references from other places."""

    def __init__(self, references, rays):
        self.references, self.rays = references, rays
        pad = ((0, 0), (MARGIN, MARGIN))
        self.padded = [np.pad(image.astype(np.float32), pad, mode="wrap") for image in references.pixels]

    def view(self, source, position, profile):
        dx, dy = position - self.references.positions[source]
        rays = self.rays
        map_x, map_y = warping.warp_table(
            profile, rays.tangents, rays.floor, dx, dy, rays.top, rays.row_step, len(profile), MARGIN
        )
        map_x, map_y = map_x.astype(np.float32), map_y.astype(np.float32)
        pixels = cv2.remap(self.padded[source], map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        seen = (map_y > -0.5) & (map_y < len(pixels) - 0.5)
        pixels[~seen] = 0.0
        return pixels, seen


def nearest(positions, position):
    """Indices by distance, and the distances."""
    distances = np.hypot(*(positions - position).T)
    order = np.argsort(distances, kind="stable")
    return order, distances[order]


def swept_profile(warper, index, settings):
    """Wall distances around one reference: the best of those tried, and once more around it."""
    columns = warper.references.pixels.shape[2]
    walls = np.log(np.geomspace(0.3, 18.0, settings.virtual_places.wall_distances))
    step = walls[1] - walls[0]
    tried = np.tile(walls[:, None], columns)
    coarse = peaks(scores(warper, index, np.exp(tried), settings), tried)
    closer = coarse + step * np.array((-0.6, -0.3, 0.0, 0.3, 0.6))[:, None]
    return np.exp(np.clip(peaks(scores(warper, index, np.exp(closer), settings), closer), walls[0], walls[-1]))


def scores(warper, index, walls, settings):
    """Agreement of the neighbours with one reference, of walls (k, columns)."""
    references = warper.references
    columns = references.pixels.shape[2]
    z, usable = features(references.pixels[index], None, settings)
    agreement, energy = np.zeros(walls.shape), np.full(walls.shape, 1e-3)
    order, distances = nearest(references.positions, references.positions[index])
    for neighbour in order[distances > 0.0][: settings.virtual_places.neighbours]:
        for row, wall in enumerate(walls):
            pixels, seen = warper.view(neighbour, references.positions[index], wall)
            warped, seen = features(pixels, seen, settings)
            agreement[row] += np.real(z * warped.conj()).sum(axis=0)
            energy[row] += 0.5 * (np.abs(z) ** 2 * seen + np.abs(warped) ** 2 * usable).sum(axis=0)
    # A running mean over the circle.
    width = max(1, round(SMOOTHING_DEG * columns / 360.0))
    window = (np.arange(columns)[:, None] + np.arange(width) - width // 2) % columns
    return agreement[:, window].sum(axis=2) / energy[:, window].sum(axis=2)


def peaks(score, logs):
    """Logarithm of the best distance, by the parabola through it and its neighbours."""
    at = np.arange(score.shape[1])
    best = score.argmax(axis=0)
    inner = np.clip(best, 1, len(score) - 2)
    before, here, after = score[inner - 1, at], score[inner, at], score[inner + 1, at]
    bend = before - 2.0 * here + after
    sharp = (bend < 0.0) & (inner == best)
    offset = np.zeros(len(at))
    offset[sharp] = 0.5 * (before - after)[sharp] / bend[sharp]
    return logs[best, at] + offset * (logs[1] - logs[0])


def synthesised(warper, profiles, position, settings):
    """Features at a place from the nearest references."""
    references = warper.references
    order, distances = nearest(references.positions, position)
    if distances[0] < 1e-6:
        return features(references.pixels[order[0]], None, settings)
    total = weights = 0.0
    for source, distance in zip(order[: settings.virtual_places.sources], distances, strict=False):
        profile = warping.moved_profile(profiles[source], *(position - references.positions[source]))
        pixels, seen = warper.view(source, position, profile)
        z, usable = features(pixels, seen, settings)
        weight = 1.0 / (distance + NEAR_M)
        total, weights = total + weight * z, weights + weight * usable
    return np.divide(total, weights, out=np.zeros_like(total), where=weights > 0.0), weights > 0.0


def eigenspace(view, count, components):
    """Eigenimages of at most 300 views, and the coefficients of all."""
    chosen = np.unique(np.linspace(0, count - 1, min(count, BASIS_IMAGES)).round().astype(int))
    basis = np.stack([view(index).ravel() for index in chosen]).astype(np.complex64)
    # conj(<a, b>) for all pairs, in double precision, block by block as memory is short.
    gram = sum(
        block @ block.conj().T
        for block in (basis[:, k : k + 4096].astype(np.complex128) for k in range(0, basis.shape[1], 4096))
    )
    values, vectors = np.linalg.eigh(gram)
    scale, vectors = np.sqrt(values[::-1][:components]), vectors[:, ::-1][:, :components]
    eigenimages = (vectors / scale).conj().T.astype(np.complex64) @ basis
    coefficients = np.empty((count, components), dtype=np.complex64)
    coefficients[chosen] = vectors * scale
    del basis
    for index in np.setdiff1d(np.arange(count), chosen):
        coefficients[index] = eigenimages.conj() @ view(index).ravel().astype(np.complex64)
    return eigenimages, coefficients


def build(references, rays, positions, settings, components):
    """Profiles, eigenimages and coefficients of a map."""
    warper = Warper(references, rays)
    profiles = np.stack([swept_profile(warper, index, settings) for index in range(len(references))])
    return (
        profiles,
        *eigenspace(lambda index: synthesised(warper, profiles, positions[index], settings)[0], len(positions), components),
    )

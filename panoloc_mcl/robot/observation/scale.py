"""The resolution at which panoramas are compared, chosen from the references.

Features live at the scale of a pixel. Where pixels are finer than what a camera resolved, or than what stays the same from one place to
the next (leaves, noise), features of neighbouring images have nothing to do with each other; where they are coarser than need be, wrong
poses fit by chance. Both are in one figure: how far a neighbour's image, warped to a reference's pose, agrees with the reference's
image, in standard deviations of how far it does at wrong headings (the deflection of a matched filter). It is taken for the images as
they are and in other light, and the resolution is that where it is largest. So the same images give the same map, however large
somebody has made them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial import cKDTree

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.observation.disturbances import spatial_light
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles

Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]
Shape = tuple[int, int]

# Resolutions that are tried, as divisors of the images' own.
_DIVISORS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)
# More columns cost more than they tell: twice as many as a degree each take four times as long. Fewer hold no view.
_MOST_COLUMNS, _FEWEST_COLUMNS, _FEWEST_ROWS = 720, 40, 8
# So many cost next to nothing: there is no need to save what might show little.
_CHEAP_COLUMNS = 120
# The last steps of refinement look at every fourth pixel.
_MULTIPLE = 4
# Groups of neighbouring references that are looked at, and references in each.
_GROUPS, _GROUP = 3, 5
# Those of a group are at least so far apart where there are enough of them: nearer ones hardly differ, however coarse or fine.
_LEAST_APART_M = 0.2
# Images whose spectrum is taken, and the share of its energy that is looked for.
_SPECTRA, _RESOLVED = 20, 0.9
# A resolution is better where it is by so many standard errors; once one is this much worse (logarithm), coarser ones are, too.
_STANDARD_ERRORS, _PAST_THE_PEAK = 2.0, 0.2
# Headings nearer than this are not wrong, degrees.
_OTHER_TURN_DEG = 20.0


def at_resolution(panorama: Panorama, shape: Shape) -> Panorama:
    """A panorama in so many rows and columns, column 0 along the heading as before; of fewer, each is the mean of what it covers."""
    if panorama.pixels.shape == shape:
        return panorama
    pixels = _resized(panorama.pixels, shape)
    if panorama.valid is None:
        return Panorama(pixels, None)
    valid = np.abs(_resized(panorama.valid.astype(np.float32), shape) - 1.0) < 0.01
    return Panorama(pixels * valid, valid)


def references_at(references: ReferencePanoramas, shape: Shape) -> ReferencePanoramas:
    """All references in so many rows and columns."""
    geometry = references.geometry
    if geometry.shape == shape:
        return references
    smaller = [at_resolution(references.panorama(index), shape) for index in range(len(references))]
    return replace(
        references,
        pixels=np.stack([np.clip(np.rint(one.pixels), 0, 255).astype(np.uint8) for one in smaller]),
        valid=None if references.valid is None else np.stack([_valid(one) for one in smaller]),
        geometry=PanoramaGeometry(shape[1], shape[0], geometry.elevation_bottom_deg, geometry.elevation_top_deg),
    )


def resolution_of(references: ReferencePanoramas, settings: VotesSettings, threads: int = 1) -> Shape:
    """Rows and columns at which panoramas are compared: as the settings have it, or where neighbours fit most clearly.

    Parameters
    ----------
    references : ReferencePanoramas
    settings : VotesSettings
    threads : int
        Groups of references that are worked on at once; the result does not depend on it.
    """
    rows, columns = references.geometry.shape
    if settings.columns is not None:
        width = min(settings.columns, columns)
        return max(1, round(rows * width / columns)), width
    shapes = list(_shapes((rows, columns), detail_columns(references)))
    if len(shapes) == 1 or len(np.unique(references.positions, axis=0)) < 2:
        return shapes[0]
    # What is finer than the finest of them costs time and decides nothing.
    groups = [references_at(group, shapes[0]) for group in _groups(references)]
    scores: list[Float64] = []
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for shape in shapes:
            scores.append(np.concatenate(list(pool.map(partial(_deflections, shape=shape, settings=settings), groups))))
            if scores[-1].mean() < max(score.mean() for score in scores) - _PAST_THE_PEAK:
                break
    best = int(np.argmax([score.mean() for score in scores]))
    better = scores[best] - scores[0]
    # What is not clear is left as it is.
    clear = better.mean() > _STANDARD_ERRORS * better.std() / np.sqrt(len(better))
    return shapes[best] if clear else shapes[0]


def detail_columns(references: ReferencePanoramas) -> float:
    """How many columns hold what the images show: those of images that were enlarged, or are blurred, show less than they could.

    The gradients of a scene have about the same energy at all frequencies that a camera resolves (its power falls with the square of
    the frequency; Field 1987), so the frequency below which nine tenths of it lie is nine tenths of the highest one resolved.
    """
    columns = references.geometry.width
    energy = np.zeros(columns // 2 + 1)
    chosen = np.unique(np.linspace(0, len(references) - 1, _SPECTRA).round().astype(int))
    for index in chosen:
        panorama = references.panorama(int(index))
        grey = panorama.pixels
        if panorama.valid is not None:
            means = (grey * panorama.valid).sum(axis=1) / np.maximum(panorama.valid.sum(axis=1), 1)
            grey = np.where(panorama.valid, grey, means[:, None])
        energy += np.square(np.abs(fft.rfft(grey, axis=1))).sum(axis=0)
    energy *= np.square(np.sin(np.pi * np.arange(len(energy)) / columns))
    cumulative = np.cumsum(energy)
    if cumulative[-1] <= 0.0:
        return float(columns)
    return 2.0 * float(np.searchsorted(cumulative, _RESOLVED * cumulative[-1])) / _RESOLVED


def _shapes(own: Shape, detail: float) -> Iterator[Shape]:
    """Resolutions to try, the finest first: one that holds the detail, and coarser ones."""
    rows, columns = own
    shapes = [own]
    for divisor in _DIVISORS[1:]:
        width = round(columns / divisor / _MULTIPLE) * _MULTIPLE
        if width >= _FEWEST_COLUMNS and rows / divisor >= _FEWEST_ROWS:
            shapes.append((round(rows * width / columns), width))
    wanted = max(detail, _CHEAP_COLUMNS)
    first = int(np.argmin([abs(np.log(width / wanted)) for _, width in shapes]))
    while first + 1 < len(shapes) and shapes[first][1] > _MOST_COLUMNS:
        first += 1
    yield from shapes[first:]


def _groups(references: ReferencePanoramas) -> Iterator[ReferencePanoramas]:
    """Neighbouring references from all over the map, far enough apart in each group to differ."""
    positions = references.positions
    extent = float(np.hypot(*np.ptp(positions, axis=0)))
    for start in np.linspace(0, len(references) - 1, 2 * _GROUPS + 1).round().astype(int)[1::2]:
        order = np.argsort(np.hypot(*(positions - positions[start]).T), kind="stable")
        apart = _LEAST_APART_M
        chosen = _spread(positions, order, apart)
        while len(chosen) < min(_GROUP, len(references)) and apart > 1e-3 * extent:
            apart *= 0.5
            chosen = _spread(positions, order, apart)
        if len(chosen) > 1:
            yield references.of(np.sort(chosen))


def _spread(positions: Float64, order: NDArray[np.int64], apart: float) -> NDArray[np.int64]:
    kept: list[int] = []
    for index in order:
        if all(np.hypot(*(positions[index] - positions[other])) >= apart for other in kept):
            kept.append(int(index))
        if len(kept) == _GROUP:
            break
    return np.array(kept, dtype=np.int64)


def _deflections(group: ReferencePanoramas, shape: Shape, settings: VotesSettings) -> Float64:
    """Logarithms of how clearly each reference's image fits its best neighbour, as it is and in other light, float64 (2 n,)."""
    small = references_at(group, shape)
    synthesizer = None
    if settings.virtual_places.enabled and small.camera_height_m is not None:
        synthesizer = ViewSynthesizer(small, sweep_profiles(small, small.camera_height_m, settings), small.camera_height_m)
    tree = cKDTree(small.positions)
    found = []
    for index, position in enumerate(small.positions):
        rng = np.random.default_rng(index)
        dark = Panorama(spatial_light(group.pixels[index], rng).astype(np.float32), group.panorama(index).valid)
        images = [orientations(one, settings)[0] for one in (small.panorama(index), at_resolution(dark, shape))]
        spectra = [fft.fft(image, axis=1) for image in images]
        best = np.full(2, -np.inf)
        distances, others = (np.asarray(part) for part in tree.query(position, k=len(small)))
        for distance, other in zip(distances, others, strict=True):
            if distance == 0.0:
                continue
            views = [small.panorama(int(other))]
            if synthesizer is not None:
                views.append(synthesizer.view(int(other), position, synthesizer.profile_at(int(other), position)))
            for view in views:
                spectrum = fft.fft(orientations(view, settings)[0], axis=1).conj()
                best = np.maximum(best, [_deflection(np.sum(one * spectrum, axis=0)) for one in spectra])
        found.append(best)
    # At or below chance there is nothing to compare.
    return np.asarray(np.log(np.maximum(np.concatenate(found), 1.0)))


def _deflection(spectrum: Complex64) -> float:
    """Correlation at the given heading, in standard deviations of that at other headings."""
    turns = fft.ifft(spectrum).real
    apart = max(1, round(_OTHER_TURN_DEG * len(turns) / 360.0))
    others = turns[apart : len(turns) - apart + 1]
    return float((turns[0] - others.mean()) / max(float(others.std()), 1e-12))


def _resized(image: NDArray[np.float32], shape: Shape) -> NDArray[np.float32]:
    smaller = shape[1] < image.shape[1]
    # Column 0 looks along the heading by its centre; an image that is resized begins where the other one does, at an edge.
    turned = _turned(image, 0.5 * (image.shape[1] / shape[1] - 1.0))
    return np.asarray(cv2.resize(turned, shape[::-1], interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR))


def _turned(image: NDArray[np.float32], columns: float) -> NDArray[np.float32]:
    """All columns moved to the right by so many, around the circle; between two, by a cubic through four.

    A line between the two would blur: half a column aside, it takes the mean of both.
    """
    whole = math.floor(columns)
    t = columns - whole
    if t == 0.0:
        return np.roll(image, whole, axis=1)
    # Catmull-Rom.
    shares = (
        -0.5 * t + t**2 - 0.5 * t**3,
        1.0 - 2.5 * t**2 + 1.5 * t**3,
        0.5 * t + 2.0 * t**2 - 1.5 * t**3,
        0.5 * t**3 - 0.5 * t**2,
    )
    parts = (np.float32(share) * np.roll(image, whole - 1 + k, axis=1) for k, share in enumerate(shares))
    return np.asarray(sum(parts))


def _valid(panorama: Panorama) -> NDArray[np.bool_]:
    return np.ones(panorama.pixels.shape, dtype=np.bool_) if panorama.valid is None else panorama.valid

"""Where a keyframe was really taken whose given pose no neighbour bears out: its image is looked for among all the others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.map.keyframes import BELIEVED, Edges
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import PoseRefiner, ViewSynthesizer, synthetic_features, virtual_positions
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Complex64 = NDArray[np.complex64]

# Views that are most like an image, some way apart, and from which its pose is approached.
_CANDIDATES = 5
# Distance between views that an image is looked for in, and between candidates, in spacings of keyframes.
_VIEWS, _APART = 0.35, 0.7
# These are no smaller than this, metres: where a way was driven twice, the nearest keyframe stands millimetres off.
_LEAST_SPACING_M = 0.25
# Two keyframes that see each other see what lies between them: in the circle over the line between them, and a little around.
_BETWEEN = 1.1
_NOTHING_KEPT, _KEPT_TOGETHER = Parts(), 64


def relocated(
    synthesizer: ViewSynthesizer,
    lost: Int64,
    settings: VotesSettings,
    sufficient: float,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
) -> dict[int, Float64]:
    """Where images fit among the other keyframes.

    Parameters
    ----------
    synthesizer : ViewSynthesizer
        Of all keyframes, with their depths.
    lost : int64 (k,)
        Keyframes that are looked for; views are made from the others.
    settings : VotesSettings
    sufficient : float
        Agreement (cosine) of an image with the view at a pose that is taken.
    progress : callable (done, total, what)
    threads : int
        Views that are made at once; the result does not depend on it.
    parts : Parts
        Where what is done is kept.

    Returns
    -------
    dict of int to float64 (3,)
        Pose of the panorama, for those that fit somewhere.
    """
    references = synthesizer.references
    others = np.setdiff1d(np.arange(len(references)), lost)
    if len(others) < 2:
        return {}
    trusted = synthesizer.of(others)
    refiner = PoseRefiner(trusted, settings)
    spacing = max(Places(trusted.references.positions).spacing, _LEAST_SPACING_M)
    grid = settings.virtual_places.model_copy(update={"spacing_m": _VIEWS * spacing})
    places = virtual_positions(trusted.references.positions, spacing, grid)
    images = [orientations(references.panorama(int(index)), settings) for index in lost]
    scores, headings = _likeness([z for z, _ in images], trusted, places, settings, progress, threads, parts)
    found = {}
    for row, index in enumerate(lost):
        starts = [np.array([*places[place], headings[row, place]]) for place in _apart(scores[row], places, _APART * spacing)]
        measured, _ = refiner.refine_best(*images[row], starts)
        if measured.agreement.cosine >= sufficient:
            found[int(index)] = measured.pose
    return found


def _likeness(
    images: list[Complex64],
    trusted: ViewSynthesizer,
    places: Float64,
    settings: VotesSettings,
    progress: Progress,
    threads: int,
    parts: Parts,
) -> tuple[Float64, Float64]:
    """Best cosine over all headings of every image with the view at every place, and that heading: float64 (images, places) each."""
    spectra = [fft.fft(z, axis=1) for z in images]
    norms = [float(np.linalg.norm(z)) for z in images]

    def compared(place: int) -> Iterator[tuple[Float64, Float64]]:
        view, _ = synthetic_features(trusted, places[place], settings)
        spectrum, norm = fft.fft(view, axis=1).conj(), float(np.linalg.norm(view))
        turns = [fft.ifft(np.sum(mine * spectrum, axis=0)).real for mine in spectra]
        scores = [float(turn.max()) / max(norm * mine, 1e-12) for turn, mine in zip(turns, norms, strict=True)]
        yield np.array(scores), 2.0 * np.pi * np.argmax(turns, axis=1) / view.shape[1]

    scores, headings = parts.listed("search for lost references", len(places), _KEPT_TOGETHER, compared, threads, progress)
    return scores.T, headings.T


def _apart(scores: Float64, places: Float64, distance: float) -> list[int]:
    """The best few places, none nearer to a better one than a distance."""
    chosen: list[int] = []
    for place in np.argsort(-scores, kind="stable").tolist():
        if all(np.hypot(*(places[place] - places[other])) >= distance for other in chosen):
            chosen.append(place)
        if len(chosen) == _CANDIDATES:
            break
    return chosen


def contradicted(positions: Float64, index: int, edges: Edges) -> bool:
    """Whether a keyframe that no other fits stands where others see each other: then no wall excuses it, and its pose is wrong."""
    believed = (edges.weights >= BELIEVED) & (edges.first != index) & (edges.second != index)
    a, b = positions[edges.first[believed]], positions[edges.second[believed]]
    middle, radius = 0.5 * (a + b), 0.5 * np.hypot(*(b - a).T)
    return bool(np.any(np.hypot(*(middle - positions[index]).T) <= _BETWEEN * radius))

"""Bag of visual words.

J. Sivic & A. Zisserman, "Video Google: a text retrieval approach to object matching in videos", ICCV 2003. SIFT descriptors of the
references are clustered into a vocabulary by k-means; an image is the histogram of its words, each weighted by how rare it is (tf-idf),
and the reference of the highest cosine is the answer.

Decided here: OpenCV's SIFT on the enlarged panorama and its k-means (seeded); columns beyond the seam are repeated, so that no feature
is cut. Retrieval gives no heading, so that equal words of two images tell it by the turn between the directions that they stand in: the
sum over all pairs, rare words counting more, smoothed over ``heading_width_deg``. Votes are the cosine times the share of the turn in
the best one of that reference.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer, raise_textureless
from panoloc_mcl.laboratory.peers.settings import BagOfWordsSettings
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

Float64 = NDArray[np.float64]

_MARGIN_SHARE = 32
_DESCRIPTORS, _ROUNDS = 20_000, 10


class BagOfWordsModel(Peer[BagOfWordsSettings]):
    """Retrieval by visual words (model ``bag_of_words``)."""

    name = "bag_of_words"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: BagOfWordsSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Vocabulary, and the words of the references with the columns that they stand in."""
        found = []
        for index, image in enumerate(images):
            found.append(_features(image, settings))
            progress(index + 1, len(images), "features")
        raise_textureless(references, [len(columns) == 0 for columns, _ in found])
        descriptors = np.concatenate([part for _, part in found])
        every = max(1, len(descriptors) // _DESCRIPTORS)
        words = min(settings.words, len(descriptors[::every]))
        cv2.setRNGSeed(0)
        criteria = (cv2.TERM_CRITERIA_MAX_ITER, _ROUNDS, 0.0)
        _, _, centres = cv2.kmeans(
            np.ascontiguousarray(descriptors[::every]),
            words,
            None,
            criteria,
            1,
            cv2.KMEANS_PP_CENTERS,
        )
        return {
            "centres": np.asarray(centres, dtype=np.float32),
            "counts": np.array([len(columns) for columns, _ in found], dtype=np.int64),
            "columns": np.concatenate([columns for columns, _ in found]).astype(np.float32),
            "words": _words(descriptors, centres).astype(np.int32),
        }

    def __init__(self, references: ReferencePanoramas, settings: BagOfWordsSettings, arrays: Any) -> None:
        super().__init__(references, settings, arrays)
        ends = np.cumsum(self._arrays["counts"])[:-1]
        self._of = list(zip(np.split(self._arrays["columns"], ends), np.split(self._arrays["words"], ends), strict=True))
        size = len(self._arrays["centres"])
        histograms = np.stack([np.bincount(words, minlength=size) for _, words in self._of]).astype(np.float64)
        self._idf = np.log(len(histograms) / np.maximum((histograms > 0).sum(axis=0), 1.0))
        self._weights = _unit(histograms * self._idf)

    def problem(self, image: Float32) -> str:
        """Images without features say nothing."""
        return super().problem(image) or ("" if len(_features(image, self.settings)[0]) else "image has no texture")

    def votes(self, image: Float32) -> Float32:
        """By cosine of the histograms, and by the turn that most pairs of equal words tell."""
        columns, descriptors = _features(image, self.settings)
        words = _words(descriptors, self._arrays["centres"])
        mine = _unit((np.bincount(words, minlength=len(self._idf)) * self._idf)[None])[0]
        alike = np.clip(self._weights @ mine, 0.0, 1.0)
        turns = np.stack([self._turns(columns, words, *other) for other in self._of], axis=1)
        return np.asarray(alike * turns / np.maximum(turns.max(axis=0), 1e-12), dtype=np.float32)

    def _turns(self, columns: Float32, words: NDArray[np.int64], others: Float32, theirs: NDArray[np.int32]) -> Float64:
        """How much pairs of equal words are for each turn, float64 (columns,)."""
        order = np.argsort(theirs, kind="stable")
        first = np.searchsorted(theirs[order], words)
        count = np.searchsorted(theirs[order], words, side="right") - first
        mine = np.repeat(np.arange(len(words)), count)
        other = order[np.repeat(first, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)]
        # A robot that has turned to the left sees things farther to the right: in later columns.
        turn = np.rint(columns[mine] - others[other]).astype(np.int64) % self._columns
        weight = (self._idf[words] ** 2 / np.maximum(count, 1))[mine]
        votes = np.bincount(turn, weights=weight, minlength=self._columns)
        distance = np.minimum(np.arange(self._columns), self._columns - np.arange(self._columns)) * (360.0 / self._columns)
        kernel = np.exp(-0.5 * (distance / self.settings.heading_width_deg) ** 2)
        return np.maximum(np.fft.irfft(np.fft.rfft(votes) * np.fft.rfft(kernel), self._columns), 0.0)


def _features(image: Float32, settings: BagOfWordsSettings) -> tuple[Float32, Float32]:
    """Columns (n,) and root-SIFT descriptors (n, 128) of an image (rows, columns)."""
    columns = image.shape[1]
    margin = max(columns // _MARGIN_SHARE, 1)
    circle = np.hstack([image[:, -margin:], image, image[:, :margin]])
    scale = settings.width / columns
    # Nearly square pixels are what SIFT wants; rows of panoramas are often finer than columns.
    large = cv2.resize(np.asarray(np.clip(np.rint(circle), 0, 255), dtype=np.uint8), None, fx=scale, fy=max(1.0, scale / 2.0))
    points, descriptors = cv2.SIFT_create(settings.features).detectAndCompute(large, None)  # type: ignore[attr-defined]
    if descriptors is None or not len(points):
        return np.zeros(0, dtype=np.float32), np.zeros((0, 128), dtype=np.float32)
    at = np.array([point.pt[0] for point in points], dtype=np.float32) / scale - margin
    inside = (at >= 0.0) & (at < columns)
    shares = descriptors[inside] / np.maximum(descriptors[inside].sum(axis=1, keepdims=True), 1e-9)
    return at[inside], np.asarray(np.sqrt(shares), dtype=np.float32)


def _words(descriptors: Float32, centres: Float32) -> NDArray[np.int64]:
    """Index of the nearest centre of each descriptor."""
    return np.asarray(np.argmax(descriptors @ centres.T - 0.5 * np.square(centres).sum(axis=1), axis=1), dtype=np.int64)


def _unit(histograms: Float64) -> Float64:
    return np.asarray(histograms / np.maximum(np.linalg.norm(histograms, axis=1, keepdims=True), 1e-12))

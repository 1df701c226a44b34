"""What the models with an eigenspace of grey levels share: scaling, the eigenspace itself, and votes by distance in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.eigenspace.pca import Eigenspace, principal_components
from panoloc_mcl.robot.errors import MapError

Float32 = NDArray[np.float32]


def unit_energy(images: Float32) -> Float32:
    """Images (..., rows, columns) scaled to a sum of squares of 1, so that a gain has no effect."""
    norms = np.sqrt(np.square(images.astype(np.float64)).sum(axis=(-2, -1), keepdims=True))
    return np.asarray(images / norms, dtype=np.float32)


def refuse_equal(images: Float32, model: str) -> None:
    """Refuse references whose differences an eigenspace cannot tell.

    Raises
    ------
    MapError
        A single reference, or all of them the same image.
    """
    if not np.ptp(images, axis=0).any():
        raise MapError(
            f"observation.model = {model}: its eigenspace is of the differences between references, and these do not differ; "
            "add references or use another model"
        )


def centred_eigenspace(images: Float32, components: int, model: str) -> tuple[Eigenspace, Float32]:
    """Eigenspace of images (k, rows, columns) without their mean, and the mean's own projection (p,).

    Raises
    ------
    MapError
        Images that do not differ, or more components than they span.
    """
    refuse_equal(images, model)
    flat = images.reshape(len(images), -1)
    mean = flat.mean(axis=0, dtype=np.float64).astype(np.float32)
    eigenspace = principal_components(flat - mean, components, f"observation.{model}.components")
    return eigenspace, np.asarray(eigenspace.eigenimages @ mean, dtype=np.float32)


def distance_votes(products: NDArray[Any], image_energy: NDArray[Any], coefficients: NDArray[Any], width: float) -> Float32:
    """Votes 1 / (1 + (d / w)^2) by the distance d in the eigenspace, which rank places as the nearest neighbour does.

    A Gaussian, as the paper's votes by angle have it, would leave nothing of images in other light, all of whose distances are
    large.

    Parameters
    ----------
    products : float (h, k)
        Inner products of the image's coefficients at each heading with the references'.
    image_energy : float (h,) or (1,)
        Squared length of the image's coefficients.
    coefficients : float or complex (k, p)
        Of the references.
    width : float
        w as a share of the root mean square length of the references' coefficients.

    Returns
    -------
    float32 (h, k), in (0, 1]
    """
    energies = np.square(np.abs(coefficients.astype(np.complex128))).sum(axis=1)
    squared = image_energy[:, None].astype(np.float64) + energies - 2.0 * products
    return np.asarray(1.0 / (1.0 + np.maximum(squared, 0.0) / (width**2 * energies.mean())), dtype=np.float32)

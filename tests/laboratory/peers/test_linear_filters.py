from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import texture
from scipy import ndimage

from panoloc_mcl.laboratory.peers.linear_filters import (
    DIRECTIONS_DEG,
    GRADIENT_FILTERS,
    basis_responses,
    filter_bank,
    filter_size,
    gaussian_derivative,
)


def test_responses_agree_with_scipy() -> None:
    image = texture(0).astype(np.float32)
    # Circular along the columns, the outer rows repeated.
    padded = np.pad(np.pad(image, ((1, 1), (0, 0)), mode="edge"), ((0, 0), (1, 1)), mode="wrap")
    expected = [ndimage.correlate(padded.astype(np.float64), kernel)[1:-1, 1:-1] for kernel in GRADIENT_FILTERS]
    assert np.abs(filter_bank(image) - expected).max() < 1e-4


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(-100, 100))
def test_turning_the_image_turns_the_responses(seed: int, columns: int) -> None:
    image = texture(seed).astype(np.float32)
    turned = filter_bank(np.roll(image, columns, axis=1))
    assert np.abs(turned - np.roll(filter_bank(image), columns, axis=2)).max() < 1e-4


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-50.0, 50.0))
def test_the_bank_is_linear_and_blind_to_offsets(a: float, b: float, offset: float) -> None:
    one, other = texture(1).astype(np.float32), texture(2).astype(np.float32)
    mixed = filter_bank((a * one + b * other + offset).astype(np.float32))
    assert np.abs(mixed - (a * filter_bank(one) + b * filter_bank(other))).max() < 2e-3


@pytest.mark.parametrize("index", [0, 1, 2])
def test_each_filter_answers_with_the_slope_in_its_direction(index: int) -> None:
    rows, columns = np.mgrid[0:9, 0:11].astype(np.float32)
    responses = filter_bank(2.0 * columns + 3.0 * rows)[index, 2:-2, 2:-2]
    angle = np.radians(DIRECTIONS_DEG[index])
    assert np.allclose(responses, 2.0 * np.cos(angle) + 3.0 * np.sin(angle), atol=1e-5)


def by_scipy(image: np.ndarray, kernels) -> np.ndarray:
    reach = kernels[0].shape[0] // 2
    padded = np.pad(np.pad(image, ((reach, reach), (0, 0)), mode="edge"), ((0, 0), (reach, reach)), mode="wrap")
    inner = (slice(reach, -reach), slice(reach, -reach))
    return np.stack([ndimage.correlate(padded.astype(np.float64), kernel)[inner] for kernel in kernels])


@pytest.mark.parametrize(("filters", "width"), [("gradients", 1.0), ("steerable", 0.7), ("steerable", 1.0), ("steerable", 2.5)])
def test_two_basis_responses_agree_with_the_bank_of_three(filters: Literal["gradients", "steerable"], width: float) -> None:
    """The sums of squares and of products, which are all that least squares and trimming see, from plainly correlated filters."""
    if filters == "gradients":
        bank = list(GRADIENT_FILTERS)
    else:
        along = gaussian_derivative(width).astype(np.float64)
        bank = [np.cos(a) * along + np.sin(a) * along.T for a in np.radians(DIRECTIONS_DEG)]
    one, other = texture(0).astype(np.float32), texture(1).astype(np.float32)
    three, three_other = by_scipy(one, bank), by_scipy(other, bank)
    two, two_other = basis_responses(one, filters, width), basis_responses(other, filters, width)
    assert two.dtype == np.float32
    assert two.shape == (2, *one.shape)
    scale = np.abs(three).max() ** 2
    assert np.abs((two**2).sum(axis=0) - (three**2).sum(axis=0)).max() < 1e-5 * scale
    assert np.abs((two * two_other).sum(axis=0) - (three * three_other).sum(axis=0)).max() < 1e-5 * scale


@pytest.mark.parametrize("width", [0.5, 1.0, 3.0])
def test_steerable_filters_are_derivatives_of_a_gaussian(width: float) -> None:
    kernel = gaussian_derivative(width).astype(np.float64)
    size = filter_size("steerable", width)
    assert kernel.shape == (size, size)
    assert size == 2 * np.ceil(3 * width) + 1
    x = np.arange(size) - size // 2
    bell = np.exp(-(x[:, None] ** 2 + x[None, :] ** 2) / (2 * width**2))
    expected = x[None, :] * bell
    assert np.abs(kernel / kernel.max() - expected / expected.max()).max() < 1e-6
    # A slope of 1 along the columns gives 1, one along the rows and a level nothing.
    assert (kernel * x[None, :]).sum() == pytest.approx(1.0, abs=1e-6)
    assert (kernel * x[:, None]).sum() == pytest.approx(0.0, abs=1e-6)
    assert kernel.sum() == pytest.approx(0.0, abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(-100, 100), st.sampled_from([0.6, 1.5, 3.0]))
def test_turning_the_image_turns_steered_responses(seed: int, columns: int, width: float) -> None:
    image = texture(seed).astype(np.float32)
    turned = basis_responses(np.roll(image, columns, axis=1), "steerable", width)
    assert np.abs(turned - np.roll(basis_responses(image, "steerable", width), columns, axis=2)).max() < 1e-3

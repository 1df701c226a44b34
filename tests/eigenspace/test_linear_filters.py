import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import texture
from scipy import ndimage

from panoloc_mcl.eigenspace.linear_filters import DIRECTIONS_DEG, GRADIENT_FILTERS, filter_bank


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

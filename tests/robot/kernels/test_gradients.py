import numpy as np
import pytest
from oracles import warping as naive

from panoloc_mcl.robot.kernels.gradients import normalised_gradients, plain_gradients


@pytest.mark.parametrize("doubled", [True, False])
@pytest.mark.parametrize("margin", [1, 4])
def test_normalised_gradients_agree_with_numpy(variant, doubled: bool, margin: int) -> None:
    rng = np.random.default_rng(margin)
    grey = rng.uniform(0.0, 255.0, (9, 12 + 2 * margin)).astype(np.float32)
    bad = (rng.random(grey.shape) < 0.2).astype(np.uint8)
    found = variant(normalised_gradients)(grey, bad, margin, 4.0, doubled)
    expected = naive.normalised_gradients(grey, bad, margin, 4.0, doubled)
    assert found.dtype == np.complex64
    assert found.shape == (9, 12)
    assert np.abs(found - expected).max() < 1e-5


def test_no_contrast_gives_zero_and_much_contrast_length_one(variant) -> None:
    flat = np.full((5, 8), 77.0, dtype=np.float32)
    fine = np.zeros((5, 8), dtype=np.uint8)
    assert not variant(normalised_gradients)(flat, fine, 1, 4.0, True).any()
    ramp = flat + 1000.0 * np.arange(8, dtype=np.float32)
    z = variant(normalised_gradients)(ramp, fine, 1, 4.0, True)
    assert z[1:-1] == pytest.approx(1.0, abs=1e-4)
    assert not z[[0, -1]].any()


def test_doubled_angles_forget_the_sign_of_the_contrast(variant) -> None:
    grey = np.random.default_rng(0).uniform(0.0, 255.0, (7, 10)).astype(np.float32)
    fine = np.zeros(grey.shape, dtype=np.uint8)
    one, other = (variant(normalised_gradients)(image, fine, 1, 4.0, True) for image in (grey, 255.0 - grey))
    assert np.abs(one - other).max() < 1e-5
    one, other = (variant(normalised_gradients)(image, fine, 1, 4.0, False) for image in (grey, 255.0 - grey))
    assert np.abs(one + other).max() < 1e-5


@pytest.mark.parametrize("margin", [1, 4])
def test_plain_gradients_agree_with_numpy(variant, margin: int) -> None:
    rng = np.random.default_rng(margin)
    grey = rng.uniform(0.0, 255.0, (9, 12 + 2 * margin)).astype(np.float32)
    bad = (rng.random(grey.shape) < 0.2).astype(np.uint8)
    found = variant(plain_gradients)(grey, bad, margin)
    rows, columns = np.gradient(grey.astype(np.float64))
    expected = np.where(bad, 0.0, columns + 1j * rows)[:, margin:-margin]
    expected[[0, -1]] = 0.0
    assert found.dtype == np.complex64
    assert np.abs(found - expected).max() < 1e-4

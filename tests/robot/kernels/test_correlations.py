import numpy as np
import pytest
from oracles import overlaps as brute

from panoloc_mcl.robot.kernels import correlations, warping


def test_the_product_of_spectra_agrees_with_numpy(variant) -> None:
    rng = np.random.default_rng(1)
    real, imaginary = rng.standard_normal((2, 5, 7, 11)).astype(np.float32)
    spectrum = (rng.standard_normal((5, 7)) + 1j * rng.standard_normal((5, 7))).astype(np.complex64)
    found = variant(correlations.spectra_product)(real, imaginary, spectrum)
    assert found.dtype == np.complex64
    assert found == pytest.approx(np.einsum("frp,fr->fp", real + 1j * imaginary, spectrum), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("width", [0.3, 0.7, 3.0])
@pytest.mark.parametrize(("headings", "blocks"), [(90, 18), (64, 12), (17, 4), (8, 8)])
def test_votes_agree_with_numpy(variant, width: float, headings: int, blocks: int) -> None:
    rng = np.random.default_rng(blocks)
    norms = rng.uniform(0.5, 2.0, (blocks, 3)).astype(np.float32)
    products = rng.uniform(-0.6, 2.2, (headings, 3)).astype(np.float32)
    angles = np.arccos(np.clip(products / brute.between_blocks(norms, headings), 0.0, 1.0))
    votes = products.copy()
    variant(correlations.to_votes)(votes, norms, width)
    assert votes == pytest.approx(np.exp(-0.5 * (angles / width) ** 2), rel=1e-5)


def test_a_place_that_shows_nothing_gets_the_votes_of_a_right_angle(variant) -> None:
    votes = np.zeros((4, 1), dtype=np.float32)
    variant(correlations.to_votes)(votes, np.zeros((2, 1), dtype=np.float32), 0.7)
    assert votes == pytest.approx(np.exp(-0.5 * (0.5 * np.pi / 0.7) ** 2), rel=1e-5)


def test_features_of_planes_agree_with_numpy(variant) -> None:
    planes = np.random.default_rng(2).random((5, 6, 4)).astype(np.float32)
    planes[..., 2] = np.where(planes[..., 2] > 0.5, 1.0, 0.98)
    z, usable = variant(warping.features_of_planes)(planes)
    assert np.array_equal(z, planes[..., 0] + 1j * planes[..., 1])
    assert np.array_equal(usable, planes[..., 2] == 1.0)

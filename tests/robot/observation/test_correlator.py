import numpy as np
import pytest
from scipy import fft

from panoloc_mcl.robot.observation.correlator import Correlator, frequencies_kept
from panoloc_mcl.robot.observation.overlap import block_energy, block_usable

ROWS, COLUMNS, COMPONENTS, PLACES = 12, 60, 5, 4


def complex_noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)


def some_correlator(eigenimages: np.ndarray, coefficients: np.ndarray, bandwidth: float = 1.0) -> Correlator:
    kept = frequencies_kept(COLUMNS, bandwidth)
    spectra = np.stack([fft.fft(image, axis=1).conj().T[kept] for image in eigenimages], axis=1).astype(np.complex64)
    views = np.einsum("kp,prc->krc", coefficients, eigenimages)
    energy = np.stack([block_energy(view.astype(np.complex64)) for view in views])
    usable = np.ones(block_usable(np.ones((ROWS, COLUMNS), dtype=bool)).shape, dtype=np.float32)
    return Correlator.of(spectra, coefficients, energy, np.stack([usable] * len(views)), COLUMNS, bandwidth)


def turned_products(z: np.ndarray, eigenimages: np.ndarray) -> np.ndarray:
    """Inner products with the image turned back by every column, (columns, p), by turning it."""
    return np.array([[np.vdot(image, np.roll(z, -h, axis=1)) for image in eigenimages] for h in range(COLUMNS)])


def test_projections_are_those_of_turned_images() -> None:
    rng = np.random.default_rng(1)
    eigenimages, z = complex_noise(rng, COMPONENTS, ROWS, COLUMNS), complex_noise(rng, ROWS, COLUMNS)
    found = some_correlator(eigenimages, complex_noise(rng, PLACES, COMPONENTS)).projections(z)
    assert found == pytest.approx(turned_products(z, eigenimages), rel=1e-4, abs=1e-2)


def test_a_glance_sees_every_fifth_heading_of_what_is_smooth() -> None:
    rng = np.random.default_rng(2)
    # Row frequencies that twelve headings hold; eigenimages are orthonormal, as those of a map.
    smooth = np.exp(1j * np.outer(np.arange(-4, 5), 2.0 * np.pi * np.arange(COLUMNS) / COLUMNS))
    images = (complex_noise(rng, COMPONENTS, ROWS, 9) @ smooth).reshape(COMPONENTS, -1)
    eigenimages = np.linalg.qr(images.T)[0].T.reshape(COMPONENTS, ROWS, COLUMNS).astype(np.complex64)
    coefficients = complex_noise(rng, PLACES, COMPONENTS)
    z = np.roll(np.einsum("p,prc->rc", coefficients[2], eigenimages), 15, axis=1).astype(np.complex64)
    votes = some_correlator(eigenimages, coefficients).glance(z, 0.7)
    products = turned_products(z, eigenimages)[::5] @ coefficients.conj().T
    cosines = products.real / (np.linalg.norm(z) * np.linalg.norm(coefficients, axis=1))
    assert votes == pytest.approx(np.exp(-0.5 * (np.arccos(np.clip(cosines, 0.0, 1.0)) / 0.7) ** 2), rel=1e-2, abs=1e-3)
    assert divmod(int(np.argmax(votes)), PLACES) == (3, 2)
    assert votes.max() == pytest.approx(1.0, abs=1e-2)


def test_a_glance_at_some_places_is_that_at_all_of_them() -> None:
    rng = np.random.default_rng(4)
    eigenimages, coefficients = complex_noise(rng, COMPONENTS, ROWS, COLUMNS), complex_noise(rng, PLACES, COMPONENTS)
    correlator, z = some_correlator(eigenimages, coefficients), complex_noise(rng, ROWS, COLUMNS)
    every = correlator.glance(z, 0.7)
    # Of the second ones, one is known from the first.
    for some in ([2, 0], [0, 3], [1, 2, 3]):
        assert correlator.glance(z, 0.7, np.array(some)) == pytest.approx(every[:, some], rel=1e-5)


def test_what_is_kept_gives_the_same_correlator() -> None:
    rng = np.random.default_rng(3)
    eigenimages, coefficients = complex_noise(rng, COMPONENTS, ROWS, COLUMNS), complex_noise(rng, PLACES, COMPONENTS)
    one = some_correlator(eigenimages, coefficients, 0.35)
    kept = one.arrays()
    # The kernel's own order: nothing is copied.
    other = Correlator.of_arrays(kept, COLUMNS, 0.35)
    assert other.real is kept["spectra_real"] is one.real
    spectra = np.ascontiguousarray((one.real + np.complex64(1j) * one.imaginary).transpose(0, 2, 1))
    before = {**{name: kept[name] for name in ("coefficients", "energy", "usable")}, "spectra": spectra}
    z, usable = complex_noise(rng, ROWS, COLUMNS), np.ones((ROWS, COLUMNS), dtype=bool)
    for again in (other, Correlator.of_arrays(before, COLUMNS, 0.35)):
        assert np.array_equal(one.votes(z, usable, 0.7), again.votes(z, usable, 0.7))

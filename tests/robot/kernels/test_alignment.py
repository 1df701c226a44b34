import numpy as np
import pytest
from oracles import warping as naive

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.kernels import alignment
from panoloc_mcl.robot.synthesis.views import FloorRays

RAYS = FloorRays.of(PanoramaGeometry(90, 36, -50.0, 25.0), 0.6)


def smooth_features(rng: np.random.Generator, rows: int = 36, columns: int = 90) -> np.ndarray:
    azimuth, row = naive.azimuths(columns)[None, :], np.arange(rows)[:, None]
    waves = zip(rng.integers(-6, 7, 12), rng.uniform(-0.4, 0.4, 12), rng.standard_normal((12, 2)), strict=True)
    return sum(complex(*a) * np.exp(1j * (m * azimuth + k * row)) for m, k, a in waves).astype(np.complex64)


def equations(variant, view, view_usable, query, query_usable, profile, every=1, columns=None):
    """Normal equations, and the sums of inner products and squared norms, as the oracle returns them."""
    products = variant(alignment.column_products)(
        view, view_usable, query, query_usable, profile, RAYS.floor, RAYS.tangents, every
    )
    columns = np.ones(view.shape[1], dtype=bool) if columns is None else columns
    return *variant(alignment.normal_equations)(products, columns, RAYS.row_step), *products[-3:, columns].sum(axis=1)


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("some", [False, True])
def test_normal_equations_agree_with_numpy(variant, every: int, some: bool) -> None:
    rng = np.random.default_rng(every)
    view, query = smooth_features(rng), smooth_features(rng)
    masks = rng.random((2, *view.shape)) < 0.8
    profile = naive.some_profile(rng)
    columns = rng.random(view.shape[1]) < 0.6 if some else None
    found = equations(variant, view, masks[0], query, masks[1], profile, every, columns)
    rest = (RAYS.floor, RAYS.tangents, RAYS.row_step, every, columns)
    expected = naive.normal_equations(view, masks[0], query, masks[1], profile, *rest)
    for one, other in zip(found, expected, strict=True):
        # Differences of single-precision features.
        assert one == pytest.approx(other, rel=1e-4, abs=1e-5 * float(np.abs(other).max()))
    assert np.array_equal(found[0], found[0].T)


@pytest.mark.parametrize("every", [1, 2])
def test_inner_products_are_those_of_the_equations(variant, every: int) -> None:
    rng = np.random.default_rng(every)
    view, query = smooth_features(rng), smooth_features(rng)
    masks = rng.random((2, *view.shape)) < 0.8
    found = variant(alignment.inner_products)(view, masks[0], query, masks[1], every)
    rest = (RAYS.floor, RAYS.tangents, RAYS.row_step, every, None)
    expected = naive.normal_equations(view, masks[0], query, masks[1], naive.some_profile(rng), *rest)
    assert found == pytest.approx(expected[-3:], rel=1e-5)


def test_nothing_in_common_gives_empty_equations(variant) -> None:
    view = smooth_features(np.random.default_rng(0))
    nowhere = np.zeros(view.shape, dtype=bool)
    found = equations(variant, view, nowhere, view, ~nowhere, np.full(90, 2.0))
    assert not any(np.any(part) for part in found)


def test_products_hold_pixels_and_energies_of_their_column(variant) -> None:
    rng = np.random.default_rng(5)
    view, query = smooth_features(rng), smooth_features(rng)
    usable = np.ones(view.shape, dtype=bool)
    usable[:, 11] = False
    arguments = (view, usable, query, usable, naive.some_profile(rng), RAYS.floor, RAYS.tangents, 1)
    products = variant(alignment.column_products)(*arguments)
    assert products.shape == (24, 90)
    assert not products[:, 11].any()
    assert products[20, 12] == 34
    inner = naive.column_agreement(query[1:-1], usable[1:-1], view[1:-1], usable[1:-1])
    for row, expected in zip(products[21:], inner, strict=True):
        assert row == pytest.approx(expected, rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("sectors", [1, 7, 30])
def test_pulls_of_sectors_are_parts_of_the_right_hand_side(variant, sectors: int) -> None:
    rng = np.random.default_rng(sectors)
    products = rng.standard_normal((24, 90))
    chosen = rng.random(90) < 0.7
    pulls = variant(alignment.sector_pulls)(products, chosen, 0.01, sectors)
    whole = variant(alignment.normal_equations)(products, chosen, 0.01)[1]
    assert pulls.shape == (sectors, 5)
    np.testing.assert_allclose(pulls.sum(axis=0), whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
    edge = 90 // sectors
    one = chosen & (np.arange(90) < edge) if 90 % sectors == 0 else None
    if one is not None:
        expected = variant(alignment.normal_equations)(products, one, 0.01)[1]
        np.testing.assert_allclose(pulls[0], expected, rtol=1e-9, atol=1e-9 * np.abs(whole).max())


@pytest.mark.parametrize(("reach", "share"), [(1, 0.6), (10, 0.6), (10, 0.95), (44, 0.6)])
def test_agreeing_columns_agree_with_windows(variant, reach: int, share: float) -> None:
    rng = np.random.default_rng(reach)
    sums = np.abs(rng.standard_normal((3, 90))) + np.array([[0.0], [1.0], [1.0]])
    windows = np.array([sums[:, np.arange(c - reach, c + reach + 1) % 90].sum(axis=1) for c in range(90)]).T
    agreement = windows[0] / np.sqrt(windows[1] * windows[2])
    found = variant(alignment.agreeing_columns)(sums, reach, share)
    assert np.array_equal(found, agreement >= share * np.sort(agreement)[3 * 90 // 4])

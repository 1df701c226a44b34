import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.kernels.alignment import normal_equations
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import PoseRefiner, SourceErrors
from panoloc_mcl.robot.synthesis.agreeing_parts import Banded, contradiction

SETTINGS, ROW_STEP, COLUMNS = VotesSettings(), np.radians(1.0), 36
TRUTH = np.array([0.8, 0.6, 1.0])


def products(rng: np.random.Generator) -> np.ndarray:
    """Sums over columns as `column_products` gives them, of random gradients at one distance each, and random differences."""
    near, lift = rng.uniform(0.2, 1.0, (2, 8, COLUMNS))
    a, b, e = rng.standard_normal((3, 8, COLUMNS))
    tangent = rng.uniform(-0.5, 0.5, (8, 1))
    parts = [near**2 * a * a, near * a * a, a * a, near**2 * a * b * lift, near * a * b * lift, near * a * b, a * b]
    parts += [near**2 * b * b * lift**2, near * b * b * lift, b * b, near * a * e, a * e, near * b * e * lift, b * e]
    parts += [near * a * a * tangent, a * a * tangent, a * a * tangent**2, near * a * b * tangent * lift, a * b * tangent]
    parts += [a * e * tangent, np.ones_like(a), a, a, a]
    return np.array([part.sum(axis=0) for part in parts])


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.integers(1, 3), st.floats(0.01, 10.0))
def test_it_is_the_scatter_of_what_bands_ask_for(seed: int, bands: int, views: int, variance: float) -> None:
    rng = np.random.default_rng(seed)
    chosen = np.ones(COLUMNS, dtype=np.bool_)
    banded = [Banded(float(rng.uniform(0.1, 1.0)), [products(rng) for _ in range(bands)], chosen) for _ in range(views)]
    # As least squares: what is left when one pose has to do for all bands instead of one for each.
    normals, rights = np.zeros((bands, 3, 3)), np.zeros((bands, 3))
    for weight, of_bands, _ in banded:
        for band, part in enumerate(of_bands):
            normal, right, _, _ = normal_equations(part, chosen, ROW_STEP)
            normals[band] += weight * normal[:3, :3]
            rights[band] += weight * right[:3]
    each = sum(float(right @ np.linalg.solve(normal, right)) for normal, right in zip(normals, rights, strict=True))
    together = float(rights.sum(axis=0) @ np.linalg.solve(normals.sum(axis=0), rights.sum(axis=0)))
    expected = (each - together) / (3 * (bands - 1) * variance)
    assert contradiction(banded, ROW_STEP, variance) == pytest.approx(expected, rel=1e-3, abs=1e-6)


def test_one_band_contradicts_nobody() -> None:
    rng, chosen = np.random.default_rng(0), np.ones(COLUMNS, dtype=np.bool_)
    one = products(rng)
    assert contradiction([], ROW_STEP, 1.0) == 0.0
    assert contradiction([Banded(1.0, [one], chosen)], ROW_STEP, 1.0) == 0.0
    assert contradiction([Banded(1.0, [one, np.zeros_like(one)], chosen)], ROW_STEP, 1.0) == 0.0
    assert contradiction([Banded(1.0, [np.zeros_like(one)] * 2, chosen)], ROW_STEP, 1.0) == 0.0


def measured(world, pixels: np.ndarray):
    z, usable = orientations(Panorama(pixels), SETTINGS)
    return PoseRefiner(world.exact, SETTINGS).refine(z, usable, np.add(TRUTH, [0.05, -0.05, np.radians(1.0)]))


def test_a_camera_that_is_not_as_described_is_noticed(fine) -> None:
    pixels = fine.room.panorama(fine.geometry, TRUTH, (0.0, 0.0)).pixels
    right = measured(fine, pixels)
    rows = pixels.shape[0]
    # All that is seen stands 3 % farther from the horizon than the description says.
    scaled = np.clip((np.arange(rows) - 0.5 * rows) / 1.03 + 0.5 * rows, 0, rows - 1)
    low, share = np.floor(scaled).astype(int), (scaled % 1.0)[:, None]
    wrong = measured(fine, ((1.0 - share) * pixels[low] + share * pixels[np.minimum(low + 1, rows - 1)]).astype(np.float32))
    assert right.contradiction < 3.0
    assert wrong.contradiction > 3.0 * right.contradiction


def test_beyond_what_is_usual_it_widens_what_is_claimed() -> None:
    errors = SourceErrors(np.array([1.3, 1.2]), np.zeros(2), np.zeros(2), 1.0, 20, 2.0)
    shown = np.diag([1e-6, 1e-6, 1e-6])
    assert errors.excess(2.0) == 0.0
    assert errors.excess(4.0) == 2.0
    wider = errors.of_image(shown, errors.excess(4.0)) / np.where(shown > 0.0, errors.of_image(shown), 1.0)
    assert (np.diag(wider) > 2.0).all()
    assert np.ptp(np.diag(wider)) == pytest.approx(0.0, abs=1e-12)


def test_maps_of_before_do_not_know_what_is_usual() -> None:
    errors = SourceErrors(np.array([1.3, 1.2]), np.zeros(2), np.zeros(2), 1.0, 20, 2.0)
    restored = SourceErrors.of_array(errors.array())
    assert restored.usual_contradiction == 2.0
    before = SourceErrors.of_array(errors.array()[:8])
    assert before.trials == 20
    assert before.excess(1000.0) == 0.0

from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, synthetic_features
from panoloc_mcl.robot.synthesis.views import FloorRays

SETTINGS = VotesSettings()
PLACES = [(0.5, 0.5), (0.3, 0.1), (1.6, 0.7), (1.0, 0.45), (-0.3, 0.4)]


def agreement(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.real(np.vdot(one, other)) / (np.linalg.norm(one) * np.linalg.norm(other)))


@pytest.mark.parametrize("source", range(6))
def test_a_reference_seen_from_its_own_place_is_itself(small, source: int) -> None:
    synthesizer, position = small.swept, small.references.positions[source]
    view = synthesizer.view(source, position, synthesizer.profile_at(source, position))
    assert view.valid is None
    assert np.abs(view.pixels - small.references.pixels[source]).max() < 0.05


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("walls", "least"), [("exact", 0.9), ("swept", 0.85)])
def test_a_synthesised_view_is_what_a_camera_sees_there(small, place: tuple[float, float], walls: str, least: float) -> None:
    truth, _ = orientations(small.room.panorama(small.geometry, (*place, 0.0)), SETTINGS)
    z, seen = synthetic_features(getattr(small, walls), np.array(place), SETTINGS)
    nearest = int(np.argmin(np.hypot(*(small.references.positions - place).T)))
    raw, _ = orientations(small.references.panorama(nearest), SETTINGS)
    assert z.dtype == np.complex64
    assert seen.mean() > 0.75
    truth = np.where(seen, truth, 0.0)
    assert agreement(truth, z) > least
    assert agreement(truth, z) > agreement(truth, raw) + 0.3


def test_at_a_reference_features_are_its_own(small) -> None:
    z, usable = synthetic_features(small.swept, small.references.positions[4], SETTINGS)
    expected, expected_usable = orientations(small.references.panorama(4), SETTINGS)
    assert np.array_equal(z, expected)
    assert np.array_equal(usable, expected_usable)


def test_what_the_source_does_not_see_is_not_shown(small) -> None:
    valid = np.ones(small.geometry.shape, dtype=bool)
    valid[:, 20:30] = False
    references = replace(small.references, valid=np.broadcast_to(valid, small.references.pixels.shape))
    masked = ViewSynthesizer(references, small.exact.profiles, 0.6)
    position = np.array([0.2, 0.1])
    plain = small.exact.view(0, position, small.exact.profile_at(0, position))
    view = masked.view(0, position, masked.profile_at(0, position))
    assert view.valid is not None
    hidden = ~view.valid & (np.ones_like(valid) if plain.valid is None else plain.valid)
    assert 0.05 < hidden.mean() < 0.25
    assert not view.pixels[~view.valid].any()
    assert np.array_equal(view.pixels[view.valid], plain.pixels[view.valid])


def test_a_coarse_table_is_the_fine_one_thinned_out(small) -> None:
    position = np.array([0.4, 0.3])
    profile = small.exact.profile_at(0, position)
    for stride in (2, 3):
        coarse, fine = (small.exact.table(0, position, profile, step) for step in (stride, 1))
        for one, other in zip(coarse, fine, strict=True):
            assert np.abs(one - other[::stride, ::stride]).max() < 1e-4


def test_rows_meet_the_floor_below_the_horizon_only(small) -> None:
    rays = FloorRays.of(small.geometry, 0.6)
    elevation = small.geometry.elevation_of_row(np.arange(36))
    assert np.isinf(rays.floor[elevation >= 0.0]).all()
    below = elevation < 0.0
    assert rays.floor[below] * np.tan(-elevation[below]) == pytest.approx(0.6)

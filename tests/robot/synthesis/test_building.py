"""Depths, views and eigenspace against plain NumPy: the same map, found another way."""

import numpy as np
import pytest
from oracles import building, warping

from panoloc_mcl.robot.eigenspace.pca import eigenspace_of
from panoloc_mcl.robot.kernels.warping import move_profile
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings
from panoloc_mcl.robot.synthesis import sweep_profiles, synthetic_features, virtual_positions

SETTINGS = VotesSettings()


def a_warper(world) -> building.Warper:
    return building.Warper(world.references, world.swept.rays)


@pytest.mark.parametrize("columns", [60, 90])
def test_all_pieces_of_wall_at_once_are_the_same(columns: int) -> None:
    rng = np.random.default_rng(columns)
    for _ in range(20):
        profile = 0.5 + np.exp(0.05 * rng.standard_normal(columns).cumsum())
        dx, dy = rng.uniform(-0.5, 0.5, 2)
        expected = warping.move_profile(profile, dx, dy)
        assert warping.moved_profile(profile, dx, dy) == pytest.approx(expected, abs=1e-9)
        assert move_profile(profile, dx, dy) == pytest.approx(expected, abs=1e-9)


def test_depths_agree_with_numpy(small) -> None:
    # Of four neighbours, two would be equally far.
    settings = VotesSettings(virtual_places=VirtualPlacesSettings(neighbours=3))
    expected = np.stack([building.swept_profile(a_warper(small), index, settings) for index in range(len(small.references))])
    difference = np.abs(sweep_profiles(small.references, small.room.height_m, settings) / expected - 1.0)
    # Single precision may prefer another of two distances that fit alike.
    assert np.mean(difference > 1e-3) < 0.01


@pytest.mark.parametrize("gradient", ["doubled_angle", "signed"])
@pytest.mark.parametrize("position", [(0.0, 1.0), (0.4, 0.3), (1.9, 0.8), (-0.7, -0.6)])
def test_views_agree_with_numpy(gradient: str, position, small) -> None:
    settings = VotesSettings(gradient=gradient)
    place = np.array(position)
    z, usable = synthetic_features(small.swept, place, settings)
    expected, expected_usable = building.synthesised(a_warper(small), small.swept.profiles, place, settings)
    assert np.mean(usable != expected_usable) < 1e-3
    same = usable & expected_usable
    difference = np.abs(z - expected)[same]
    # Single precision; a grey level at the edge of the mask may fall on either side.
    assert np.percentile(difference, 99.5) < 1e-3
    assert difference.mean() < 1e-3


def test_the_eigenspace_agrees_with_numpy(small) -> None:
    positions = virtual_positions(small.references.positions, 1.0, VirtualPlacesSettings(spacing_m=0.15))
    assert len(positions) > building.BASIS_IMAGES
    views = [synthetic_features(small.swept, position, SETTINGS)[0].ravel() for position in positions]
    eigenimages, coefficients = building.eigenspace(views.__getitem__, len(views), 12)
    found = eigenspace_of(views.__getitem__, len(views), 12, 12, "components")
    # The phase of an eigenimage is free; what a view looks like in the eigenspace is not.
    expected = coefficients @ eigenimages
    assert np.abs(found.coefficients @ found.eigenimages - expected).max() < 1e-4 * np.abs(expected).max()

import numpy as np
import pytest
from oracles import peers as brute
from oracles.scenes import COLUMNS, panorama, random_world, texture, turned

from panoloc_mcl.laboratory.peers.correlation.nearest_reference import NearestReferenceModel
from panoloc_mcl.laboratory.peers.correlation.orientation_correlation import OrientationCorrelationModel
from panoloc_mcl.laboratory.peers.correlation.template_matching import TemplateMatchingModel
from panoloc_mcl.laboratory.peers.eigenspace import EigenspaceModel
from panoloc_mcl.laboratory.peers.fourier_signature import FourierSignatureModel
from panoloc_mcl.laboratory.peers.least_squares import LeastSquaresModel
from panoloc_mcl.laboratory.peers.settings import (
    EigenspaceSettings,
    FourierSignatureSettings,
    LeastSquaresSettings,
    NearestReferenceSettings,
    OrientationCorrelationSettings,
    SpinningSettings,
    TemplateMatchingSettings,
    ZeroPhaseSettings,
)
from panoloc_mcl.laboratory.peers.spinning import SpinningModel
from panoloc_mcl.laboratory.peers.zero_phase import ZeroPhaseModel

WORLD = random_world(6)
# A turned reference, one in other light, and an image of nowhere.
IMAGES = [turned(texture(2), 17), np.rint(0.4 * turned(texture(4), 31)).astype(np.uint8), texture(50)]


@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("components", [2, 5])
@pytest.mark.parametrize("unit_energy", [True, False])
def test_eigenspace(image, components: int, unit_energy: bool) -> None:
    settings = EigenspaceSettings(components=components, unit_energy=unit_energy)
    votes = EigenspaceModel.build(WORLD, settings).observe(panorama(image)).votes
    assert votes == pytest.approx(brute.eigenspace(WORLD.pixels, image.astype(float), settings), rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("mean_column", [True, False])
def test_least_squares(image, mean_column: bool) -> None:
    settings = LeastSquaresSettings(components=4, mean_column=mean_column)
    votes = LeastSquaresModel.build(WORLD, settings).observe(panorama(image)).votes
    assert votes == pytest.approx(brute.least_squares(WORLD.pixels, image.astype(float), settings), abs=2e-3)


@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("components", [1, 40])
def test_spinning(image, components: int) -> None:
    settings = SpinningSettings(components=components)
    model = SpinningModel.build(WORLD, settings)
    frequencies = model.arrays()["frequencies"]
    # Of an eigenimage of a frequency between 0 and the highest one there are two real ones, a cosine and a sine.
    dimensions = int(np.where((frequencies == 0) | (frequencies == COLUMNS // 2), 1, 2).sum())
    expected = brute.spinning(WORLD.pixels, image.astype(float), settings, dimensions)
    assert model.observe(panorama(image)).votes == pytest.approx(expected, rel=1e-3, abs=1e-5)


def test_turned_views_have_the_same_spinning_coefficients_but_for_a_phase() -> None:
    # So all turned copies of a reference are exactly as far from the reference, which is not at all at the copy's own heading.
    model = SpinningModel.build(WORLD, SpinningSettings(components=60))
    votes = model.observe(panorama(turned(texture(3), 23))).votes
    assert votes[23, 3] == pytest.approx(1.0, abs=1e-5)
    assert np.argmax(votes) == 23 * len(WORLD) + 3


@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("width", [1.0, 12.0])
def test_zero_phase(image, width: float) -> None:
    settings = ZeroPhaseSettings(components=5, heading_width_deg=width)
    votes = ZeroPhaseModel.build(WORLD, settings).observe(panorama(image)).votes
    assert votes == pytest.approx(brute.zero_phase(WORLD.pixels, image.astype(float), settings), rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("image", IMAGES)
def test_nearest_reference(image) -> None:
    settings = NearestReferenceSettings()
    model = NearestReferenceModel.build(WORLD, settings)
    assert model.votes(image.astype(np.float32)) == pytest.approx(
        brute.nearest_reference(WORLD.pixels, image.astype(float), settings.contrast_floor), abs=1e-5
    )


@pytest.mark.parametrize("image", IMAGES)
def test_orientation_correlation(image) -> None:
    votes = OrientationCorrelationModel.build(WORLD, OrientationCorrelationSettings()).observe(panorama(image)).votes
    assert votes == pytest.approx(brute.orientation_correlation(WORLD.pixels, image.astype(float)), abs=1e-5)


@pytest.mark.parametrize("image", IMAGES)
def test_fourier_signature(image) -> None:
    model = FourierSignatureModel.build(WORLD, FourierSignatureSettings(frequencies=12))
    similarity, agreement = brute.fourier_signature(WORLD.pixels, image.astype(float), 12)
    fitting = np.maximum(agreement, 0.0)
    assert model.observe(panorama(image)).votes == pytest.approx(similarity * fitting / fitting.max(axis=0), abs=1e-5)


def test_fourier_signature_without_heading_is_the_similarity_alone() -> None:
    model = FourierSignatureModel.build(WORLD, FourierSignatureSettings(heading="none"))
    similarity, _ = brute.fourier_signature(WORLD.pixels, IMAGES[1].astype(float), 15)
    assert model.observe(panorama(IMAGES[1])).votes == pytest.approx(similarity[None, :], abs=1e-5)


@pytest.mark.parametrize("image", IMAGES)
def test_template_matching(image) -> None:
    votes = TemplateMatchingModel.build(WORLD, TemplateMatchingSettings()).observe(panorama(image)).votes
    assert votes == pytest.approx(brute.template_matching(WORLD.pixels, image.astype(float)), abs=1e-4)

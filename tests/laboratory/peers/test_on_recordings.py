"""The cited peers on single images of a recorded hall, at the light of its references; nothing known beforehand."""

from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.observation import model_named
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.datasets import read_dataset, read_image

HALL = Path(__file__).parents[4] / "shared" / "data" / "hall"
pytestmark = pytest.mark.skipif(not HALL.is_dir(), reason="needs the recorded hall beside the project")

# Nearest place found, heading within 10 degrees: the shares of every second noon image (120) less three standard deviations of
# the share of 40. By chance they would be 1 in 42 and 1 in 18.
AT_LEAST = {
    "fourier_signature": (0.80, 0.95),
    "eigenspace": (0.73, 0.89),
    "least_squares": (0.45, 0.52),
    "spinning": (0.79, 0.95),
    "zero_phase": (0.50, 0.81),
    "orientation_correlation": (0.91, 0.95),
}


@pytest.fixture(scope="module")
def hall():
    dataset = read_dataset(HALL)
    references = read_references(dataset.references)
    frames = []
    for drive in dataset.select(["noon_*"]):
        unwrap = Unwrapper(drive.camera, drive.image_size, references.geometry)
        frames += [(unwrap(read_image(drive.files[i])), drive.groundtruth.at(drive.times[i])) for i in range(3, len(drive), 6)]
    return references, frames


@pytest.mark.parametrize("name", AT_LEAST)
def test_noon(name: str, hall) -> None:
    references, frames = hall
    model = model_named(name).build(references, ObservationSettings(model=name).selected, 0)
    peaks = [model.observe(panorama).peak for panorama, _ in frames]
    truth = np.array([pose for _, pose in frames])
    nearest = model.places.nearest(truth[:, :2]) == [peak.place for peak in peaks]
    heading = np.abs(angle_difference([peak.heading for peak in peaks], truth[:, 2])) < np.radians(10.0)
    places, headings = AT_LEAST[name]
    assert nearest.mean() >= places
    assert heading.mean() >= headings

"""A map of one half of a room whose other half has the same floor, turned: images of there are not taken for images of here."""

import numpy as np
import pytest
from oracles.rooms import BareRoom
from oracles.scenes import grid

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.observation.votes import VotesModel
from panoloc_mcl.robot.settings.localizer import StatusSettings
from panoloc_mcl.robot.settings.observation import VotesSettings

ROOM = BareRoom()
GEOMETRY = PanoramaGeometry(180, 72, -50.0, 25.0)
CENTRE = 0.5 * (np.array(ROOM.low) + np.array(ROOM.high))
SURE = StatusSettings().converged_confidence


def turned(pose: np.ndarray) -> np.ndarray:
    """The pose from which the floor looks the same."""
    return np.array([*(2.0 * CENTRE - pose[:2]), pose[2] + np.pi])


def seen(pose: np.ndarray) -> Panorama:
    """Below the horizon the room is as its turned self; above it is not."""
    here, there = (ROOM.panorama(GEOMETRY, at).pixels for at in (pose, turned(pose)))
    below = GEOMETRY.elevation_of_row(np.arange(GEOMETRY.shape[0])) < 0.0
    return Panorama(np.rint(np.where(below[:, None], 0.5 * (here + there), here)).astype(np.float32))


@pytest.fixture(scope="module")
def model() -> VotesModel:
    positions = grid(4, 5, 0.5) + (CENTRE - np.array([1.9, 1.0]))
    references = ROOM.references(GEOMETRY, positions)
    for index, (x, y) in enumerate(positions):
        references.pixels[index] = seen(np.array([x, y, 0.0])).pixels
    return VotesModel.build(references, VotesSettings(thinning=False))


@pytest.mark.slow
def test_an_image_of_the_other_half_is_not_believed(model: VotesModel) -> None:
    rng = np.random.default_rng(5)
    here, there, taken_for_twin = [], [], 0
    for _ in range(12):
        pose = np.array([*(CENTRE - np.array([1.15, 0.0]) + rng.uniform(-0.6, 0.6, 2)), rng.uniform(-np.pi, np.pi)])
        field = model.observe(seen(pose))
        assert np.hypot(*(field.measurement.pose - pose)[:2]) < 0.05
        here.append(field.confidence)
        field = model.observe(seen(turned(pose)))
        taken_for_twin += bool(np.hypot(*(field.measurement.pose - pose)[:2]) < 0.1)
        there.append(field.confidence)
    assert min(here) >= SURE
    assert max(there) < SURE
    # It is the hard case: the floor fits.
    assert taken_for_twin >= 9

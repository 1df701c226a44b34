from types import SimpleNamespace

import pytest
from oracles.rooms import BareRoom
from oracles.scenes import grid

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles


def _world(columns: int, rows: int) -> SimpleNamespace:
    """Six references, a metre apart, in a bare room. Not to be changed."""
    room, geometry = BareRoom(), PanoramaGeometry(columns, rows, -50.0, 25.0)
    references = room.references(geometry, grid(3, 2))
    profiles = sweep_profiles(references, room.height_m, VotesSettings())
    return SimpleNamespace(
        room=room,
        geometry=geometry,
        references=references,
        swept=ViewSynthesizer(references, profiles, room.height_m),
        exact=ViewSynthesizer(references, room.profiles(references.positions, columns), room.height_m),
    )


@pytest.fixture(scope="session")
def small() -> SimpleNamespace:
    return _world(90, 36)


@pytest.fixture(scope="session")
def fine() -> SimpleNamespace:
    return _world(180, 72)

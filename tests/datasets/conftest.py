from pathlib import Path

import pytest

from panoloc_mcl.camera import PanoramaGeometry
from panoloc_mcl.datasets.room import build_room

SMALL = PanoramaGeometry(72, 30, -50.0, 25.0)


@pytest.fixture(scope="session")
def _room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small rendering of the room: three references, one drive of three frames. Not to be changed."""
    path = tmp_path_factory.mktemp("room") / "data"
    return build_room(path, frames=3, geometry=SMALL, grid=((0.0, 0.0), (1.0, 0.0), (3.0, 2.0)), lights=("noon",))


@pytest.fixture
def room(_room: Path, tmp_path: Path) -> Path:
    """A copy of the small room that a test may damage."""
    import shutil

    return Path(shutil.copytree(_room, tmp_path / "room"))

import shutil
from pathlib import Path

import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.datasets import Dataset, Sequence, read_dataset

# Fixtures that take more than a few seconds to make: a test that asks for one is slow.
_SLOW_FIXTURES = {"full_run", "its_map", "made", "room_map", "world_with_a_black_post"}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests of slow fixtures before ``-m`` chooses."""
    for item in items:
        if _SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def small_room(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The room in small panoramas: twelve references, one drive of twelve frames. Not to be changed."""
    grid = tuple((float(x), float(y)) for y in range(3) for x in range(4))
    path: Path = tmp_path_factory.mktemp("small_room") / "data"
    build_room(path, frames=12, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon",))
    return read_dataset(path)


@pytest.fixture(scope="session")
def panorama_map(small_room: Dataset) -> PanoramaMap:
    """A map of it. Not to be changed."""
    return PanoramaMap.build(small_room)


@pytest.fixture(scope="session")
def drive(small_room: Dataset) -> Sequence:
    """Its drive."""
    return small_room.sequences["noon_00"]


@pytest.fixture(scope="session")
def _room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A smaller rendering of it: three references, one drive of three frames. Not to be changed."""
    path = tmp_path_factory.mktemp("room") / "data"
    places = ((0.0, 0.0), (1.0, 0.0), (3.0, 2.0))
    return build_room(path, frames=3, geometry=PanoramaGeometry(72, 30, -50.0, 25.0), grid=places, lights=("noon",))


@pytest.fixture
def room(_room: Path, tmp_path: Path) -> Path:
    """A copy of the smaller room that a test may damage."""
    return Path(shutil.copytree(_room, tmp_path / "room"))

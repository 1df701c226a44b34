from pathlib import Path

import pytest

from panoloc_mcl.camera import PanoramaGeometry
from panoloc_mcl.datasets import Dataset, read_dataset
from panoloc_mcl.datasets.room import build_room


@pytest.fixture(scope="session")
def small_room(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The room in small panoramas: twelve references, one drive of twelve frames. Not to be changed."""
    grid = tuple((float(x), float(y)) for y in range(3) for x in range(4))
    path: Path = tmp_path_factory.mktemp("small_room") / "data"
    build_room(path, frames=12, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon",))
    return read_dataset(path)

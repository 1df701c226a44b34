import pytest

from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets import Sequence as Drive


@pytest.fixture(scope="module")
def panorama_map(small_room: Dataset) -> PanoramaMap:
    return PanoramaMap.build(small_room)


@pytest.fixture(scope="module")
def drive(small_room: Dataset) -> Drive:
    return small_room.sequences["noon_00"]

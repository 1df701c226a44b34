"""Maps that show a place from one side only, and robots that leave the mapped part: never sure of a wrong pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.streams import answers, recorded

_GRID = tuple((float(x), float(y)) for y in range(4) for x in range(5))
_AT = np.array(_GRID)

#: Which of the references the map has.
PARTS = {
    "two": np.array([0, 7]),
    "two far apart": np.array([1, 18]),
    "line along x": np.flatnonzero(_AT[:, 1] == 1),
    "line along y": np.flatnonzero(_AT[:, 0] == 2),
    "left part": np.flatnonzero(_AT[:, 0] <= 1),
    "lower part": np.flatnonzero(_AT[:, 1] <= 1),
}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path: Path = tmp_path_factory.mktemp("room") / "data"
    geometry = PanoramaGeometry(180, 72, -50.0, 25.0)
    return read_dataset(build_room(path, frames=24, geometry=geometry, grid=_GRID, lights=("noon", "evening")))


@pytest.mark.slow
@pytest.mark.parametrize("part", list(PARTS))
def test_it_is_never_sure_and_wrong(part: str, room: Dataset) -> None:
    chosen, whole = PARTS[part], room.references
    references = replace(whole, files=tuple(whole.files[i] for i in chosen), poses=whole.poses[chosen])
    panorama_map = PanoramaMap.build(replace(room, references=references))
    model = panorama_map.observation_model()
    for drive in room.sequences.values():
        truth = drive.groundtruth.at(drive.times)
        localizer = Localizer(panorama_map, LocalizerConfig(), model=model)
        for image, estimate in answers(localizer, recorded(drive)):
            if estimate.status is Status.CONVERGED:
                assert np.hypot(*(estimate.pose[:2] - truth[image.index][:2])) < 1.0

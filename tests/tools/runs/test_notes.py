from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.corruptions.dataset import corrupt
from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.runs.pipeline import Task, localize


def notes_of(dataset: Dataset, panorama_map: PanoramaMap) -> list[str]:
    drive = dataset.sequences["noon_00"]
    task = Task(drive, np.zeros(len(drive), dtype=np.bool_))
    return localize(task, 0, panorama_map, panorama_map.observation_model(), RunConfig())[2]


@pytest.mark.slow
def test_a_camera_that_is_not_as_described_is_noted(tmp_path: Path) -> None:
    grid = tuple((float(x), float(y)) for y in range(3) for x in range(4))
    geometry = PanoramaGeometry(180, 72, -50.0, 25.0)
    right = read_dataset(build_room(tmp_path / "right", frames=12, geometry=geometry, grid=grid, lights=("noon",)))
    panorama_map = PanoramaMap.build(right)
    assert not any("contradict" in note for note in notes_of(right, panorama_map))
    for recipe in ("elevation_scale:strong", "elevation_shift:strong"):
        wrong = read_dataset(corrupt(right, parse_recipe(recipe), 0, tmp_path / recipe.partition(":")[0]))
        (note,) = (note for note in notes_of(wrong, panorama_map) if "contradict" in note)
        assert "panoloc calibrate" in note

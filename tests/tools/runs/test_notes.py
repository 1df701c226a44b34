import numpy as np
import pytest

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.corruptions.dataset import corrupt
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.runs.pipeline import Task, localize


def notes_of(dataset: Dataset, panorama_map: PanoramaMap) -> list[str]:
    drive = dataset.sequences["noon_00"]
    task = Task(drive, np.zeros(len(drive), dtype=np.bool_))
    return localize(task, 0, panorama_map, panorama_map.observation_model(), RunConfig())[2]


@pytest.mark.slow
@pytest.mark.parametrize("recipe", ["elevation_scale:strong", "elevation_shift:strong"])
def test_a_camera_that_is_not_as_described_is_noted(
    small_room: Dataset, panorama_map: PanoramaMap, tmp_path, recipe: str
) -> None:
    assert not any("contradict" in note for note in notes_of(small_room, panorama_map))
    wrong = read_dataset(corrupt(small_room, parse_recipe(recipe), 0, tmp_path / "wrong"))
    (note,) = (note for note in notes_of(wrong, panorama_map) if "contradict" in note)
    assert "panoloc calibrate" in note

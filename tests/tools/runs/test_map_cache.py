import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from oracles.scenes import grid, texture

from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image, write_image
from panoloc_mcl.tools.datasets.writer import DatasetWriter
from panoloc_mcl.tools.runs.map_cache import cached_map

VOTES = ObservationSettings()
PAPER = ObservationSettings.model_validate(
    {"model": "paper", "paper": PaperSettings(components=2, hypotheses=2, pixels=20, trim_to=10)}
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "maps"


@pytest.fixture
def builds(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the data sets that maps were built of."""
    built: list[str] = []
    build = PanoramaMap.build.__func__  # type: ignore[attr-defined]  # the function that the class method wraps

    def counted(cls, dataset, *arguments, **more):
        built.append(dataset.name)
        return build(cls, dataset, *arguments, **more)

    monkeypatch.setattr(PanoramaMap, "build", classmethod(counted))
    return built


def a_dataset(path: Path, name: str = "textures") -> Dataset:
    writer = DatasetWriter(path, name, PanoramaCamera(elevation_deg=(-50.0, 25.0)))
    writer.add_references([texture(seed) for seed in range(3)], np.column_stack([grid(3, 1), np.zeros(3)]))
    return read_dataset(writer.finish())


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return a_dataset(tmp_path / "data")


def test_the_second_time_the_map_is_loaded(dataset: Dataset, cache: Path, builds: list[str]) -> None:
    first, second = (cached_map(dataset, VOTES, 0) for _ in range(2))
    assert len(builds) == 1
    # Beside the map, how long it took to build.
    assert sorted(path.suffix for path in cache.iterdir()) == [".panomap", ".seconds"]
    assert all(np.array_equal(first.arrays[key], second.arrays[key]) for key in first.arrays)


def test_the_same_data_elsewhere_is_the_same_map(dataset: Dataset, cache: Path, builds: list[str], tmp_path: Path) -> None:
    cached_map(dataset, VOTES, 0)
    cached_map(read_dataset(shutil.copytree(dataset.path, tmp_path / "copy")), VOTES, 0)
    assert len(builds) == 1


def change_pixel(path: Path) -> None:
    file = path / "references" / "ref_001.png"
    image = read_image(file)
    image[5, 5] ^= 1
    write_image(file, image)


def change_pose(path: Path) -> None:
    table = path / "references" / "poses.csv"
    table.write_text(table.read_text().replace("1.0,0.0", "1.125,0.0"))


def change_camera(path: Path) -> None:
    file = path / "dataset.yaml"
    file.write_text(file.read_text().replace("25.0", "26.0"))


@pytest.mark.parametrize("change", [change_pixel, change_pose, change_camera])
def test_whatever_changes_in_the_data_gives_a_new_map(change, dataset: Dataset, cache: Path, builds: list[str]) -> None:
    before = {entry.name: entry.read_bytes() for entry in dataset.path.rglob("*") if entry.is_file()}
    cached_map(dataset, VOTES, 0)
    change(dataset.path)
    assert before != {entry.name: entry.read_bytes() for entry in dataset.path.rglob("*") if entry.is_file()}
    cached_map(read_dataset(dataset.path), VOTES, 0)
    assert len(builds) == 2


@pytest.mark.parametrize(
    "other",
    [
        ObservationSettings(votes=VotesSettings(contrast_floor=5.0)),
        ObservationSettings(votes=VotesSettings(gradient="signed")),
        PAPER,
    ],
)
def test_other_settings_give_a_new_map(other: ObservationSettings, dataset: Dataset, cache: Path, builds: list[str]) -> None:
    cached_map(dataset, VOTES, 0)
    built = cached_map(dataset, other, 0)
    assert len(builds) == 2
    assert built.observation == other
    assert cached_map(dataset, VOTES, 0).observation == VOTES
    assert len(builds) == 2


def test_settings_of_the_other_model_do_not_matter(dataset: Dataset, cache: Path, builds: list[str]) -> None:
    cached_map(dataset, VOTES, 0)
    cached_map(dataset, ObservationSettings.model_validate({"paper": PaperSettings(hypotheses=7)}), 0)
    assert len(builds) == 1


def test_the_seed_gives_another_map(dataset: Dataset, cache: Path) -> None:
    one, other = (cached_map(dataset, PAPER, seed) for seed in (0, 1))
    assert not np.array_equal(one.arrays["columns"], other.arrays["columns"])


@pytest.mark.parametrize("content", [b"", b"rubbish", None])
def test_a_damaged_map_is_put_aside_and_built_again(content, dataset: Dataset, cache: Path, builds: list[str]) -> None:
    cached_map(dataset, VOTES, 0)
    (file,) = cache.glob("*.panomap")
    good = file.read_bytes()
    file.write_bytes(good[:-10] if content is None else content)
    with pytest.warns(RuntimeWarning, match="left aside"):
        cached_map(dataset, VOTES, 0)
    assert len(builds) == 2
    assert file.read_bytes() == good
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cached_map(dataset, VOTES, 0)


def test_a_cache_that_cannot_be_written_costs_only_a_warning(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A file where the folder should be: even the superuser cannot write below it.
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "file"))
    with pytest.warns(RuntimeWarning, match="not kept"):
        built = cached_map(dataset, VOTES, 0)
    assert len(built.references) == 3


def test_a_reference_that_has_gone_is_one_line(dataset: Dataset, cache: Path) -> None:
    dataset.references.files[1].unlink()
    with pytest.raises(ImageError, match=r"ref_001\.png") as caught:
        cached_map(dataset, VOTES, 0)
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize("name", ["../../outside", "a/b", "größer als sonst", "x" * 400, ".."])
def test_no_name_leads_out_of_the_cache(name: str, tmp_path: Path, cache: Path, builds: list[str]) -> None:
    dataset = a_dataset(tmp_path / "named", name)
    for _ in range(2):
        assert cached_map(dataset, VOTES, 0).name == name
    assert builds == [name]
    assert [path.parent for path in tmp_path.rglob("*.panomap")] == [cache]

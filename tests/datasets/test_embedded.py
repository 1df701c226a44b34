from pathlib import Path

import pytest

from panoloc_mcl.camera import PanoramaGeometry
from panoloc_mcl.datasets import EMBEDDED, Embedded, embedded_dataset, read_dataset, resolve_dataset
from panoloc_mcl.datasets.room import build_room
from panoloc_mcl.errors import DatasetError


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    def build(path: Path, progress: object) -> Path:
        return build_room(path, frames=1, geometry=PanoramaGeometry(36, 15, -50.0, 25.0), grid=((0.0, 0.0),), lights=("noon",))

    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setitem(EMBEDDED, "room", Embedded("small", 3, build))
    return tmp_path / "cache"


def replace_build(monkeypatch: pytest.MonkeyPatch, build: object) -> None:
    monkeypatch.setitem(EMBEDDED, "room", Embedded("small", 3, build))  # type: ignore[arg-type]


def test_rendered_once_into_the_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = embedded_dataset("room")
    assert path == cache / "room-3"
    assert len(read_dataset(path).references) == 1
    assert [p.name for p in cache.iterdir()] == ["room-3"]
    replace_build(monkeypatch, None)  # would fail if called
    assert resolve_dataset("room") == path


def test_an_interrupted_first_use_leaves_nothing(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = EMBEDDED["room"].build

    def interrupted(path: Path, progress: object) -> Path:
        whole(path, None)
        raise KeyboardInterrupt

    replace_build(monkeypatch, interrupted)
    with pytest.raises(KeyboardInterrupt):
        embedded_dataset("room")
    assert list(cache.iterdir()) == []


def test_two_first_uses_at_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = EMBEDDED["room"].build

    def slow(path: Path, progress: object) -> Path:
        whole(cache / "room-3", None)  # another process is done while this one renders
        return whole(path, None)

    replace_build(monkeypatch, slow)
    assert len(read_dataset(embedded_dataset("room")).references) == 1
    assert [p.name for p in cache.iterdir()] == ["room-3"]


def test_half_a_data_set_is_rendered_anew(cache: Path) -> None:
    (embedded_dataset("room") / "dataset.yaml").unlink()
    assert len(read_dataset(embedded_dataset("room")).references) == 1


def test_a_cache_that_cannot_be_written(cache: Path) -> None:
    cache.write_text("in the way")
    with pytest.raises(DatasetError, match="PANOLOC_CACHE_DIR"):
        embedded_dataset("room")


def test_resolving_names_and_paths(cache: Path, room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert resolve_dataset(room) == room
    assert resolve_dataset(str(room)) == room
    monkeypatch.chdir(room.parent)
    assert resolve_dataset("room") == Path("room")  # a data set here goes before the embedded one
    with pytest.raises(DatasetError, match=r"'rooom': neither a folder nor an embedded data set .*did you mean 'room'"):
        resolve_dataset("rooom")
    with pytest.raises(DatasetError, match=r"\(hall, room\); check the path"):
        resolve_dataset("/nowhere/at/all")
    with pytest.raises(DatasetError, match="known: hall, room"):
        embedded_dataset("cellar")


def test_the_shipped_hall() -> None:
    path = embedded_dataset("hall")
    dataset = read_dataset(path)
    assert len(dataset.references) == 42
    assert list(dataset.sequences) == ["afternoon_00", "evening_00", "noon_00", "people_00"]
    assert all(sequence.odometry is not None and sequence.groundtruth is not None for sequence in dataset.sequences.values())
    assert sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) < 8_000_000

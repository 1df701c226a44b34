from pathlib import Path

import pytest

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets import EMBEDDED, check_dataset, read_dataset, resolve_dataset


def test_paths_go_as_they_are_and_names_into_the_package(room: Path) -> None:
    assert resolve_dataset(room) == room
    assert resolve_dataset(str(room)) == room
    assert resolve_dataset("hall") == EMBEDDED["hall"]


def test_a_data_set_here_goes_before_the_embedded_one(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(room.rename(room.with_name("hall")).parent)
    assert resolve_dataset("hall") == Path("hall")
    # Any other folder of that name does not: a run must not turn on what else lies about.
    (Path("hall") / "dataset.yaml").unlink()
    assert resolve_dataset("hall") == EMBEDDED["hall"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("hal", r"'hal': neither a folder nor an embedded data set \(hall\); did you mean 'hall'\?"),
        ("/nowhere/at/all", r"'/nowhere/at/all': neither a folder nor an embedded data set \(hall\); check the path"),
        ("room", r"'room': neither a folder nor an embedded data set \(hall\); check the path"),
    ],
)
def test_what_is_neither(name: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DatasetError, match=said):
        resolve_dataset(name)


def test_a_file_that_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "notes.md").touch()
    with pytest.raises(DatasetError, match=r"notes\.md': a file that is no recording \(\.bag, \.mcap, .*or a folder"):
        resolve_dataset(tmp_path / "notes.md")


def test_the_shipped_hall() -> None:
    path = EMBEDDED["hall"]
    assert check_dataset(path) == []
    dataset = read_dataset(path)
    assert len(dataset.references) == 42
    assert list(dataset.sequences) == ["afternoon_00", "evening_00", "noon_00", "people_00"]
    assert all(sequence.odometry is not None and sequence.groundtruth is not None for sequence in dataset.sequences.values())
    assert sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) < 8_000_000

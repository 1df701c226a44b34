"""Parts of a build that are kept: by which program, and that removing them removes nothing else."""

import os
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot import unfinished
from panoloc_mcl.robot.unfinished import Parts, remove_parts

KEY = "0123456789abcdef" * 4


def squares(folder: Path, made: list[slice]) -> list[int]:
    def make(block: slice) -> dict[str, np.ndarray]:
        made.append(block)
        return {"squares": np.arange(block.start, block.stop) ** 2}

    return [int(one) for _, found in Parts(folder, KEY).each("some work", 10, 4, make) for one in found["squares"]]


def test_parts_of_another_version_of_the_program_are_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[slice] = []
    expected = squares(tmp_path, made)
    assert squares(tmp_path, made) == expected
    assert len(made) == 3
    monkeypatch.setattr(unfinished, "source_digest", lambda parts: "another")
    assert squares(tmp_path, made) == expected
    assert len(made) == 6


def test_removing_parts_leaves_what_is_not_theirs(tmp_path: Path) -> None:
    folder = tmp_path / "hall.panomap.parts"
    squares(folder, [])
    # As a killed process leaves it.
    (folder / f".{next(folder.iterdir()).name}.ab_c1234.unfinished").write_bytes(b"")
    (folder / "notes.txt").write_text("mine")
    (folder / "mine.npz").write_bytes(b"mine")
    remove_parts(folder)
    assert sorted(path.name for path in folder.iterdir()) == ["mine.npz", "notes.txt"]
    (folder / "notes.txt").unlink()
    (folder / "mine.npz").unlink()
    squares(folder, [])
    remove_parts(folder)
    assert not folder.exists()
    remove_parts(folder)


def test_a_build_goes_on_though_another_of_the_same_map_ends_while_it_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "hall.panomap.parts"
    ends, synced = [True], os.fsync

    def fsync(handle: int) -> None:
        if ends and ends.pop():
            remove_parts(folder)
        synced(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    assert squares(folder, []) == [n * n for n in range(10)]
    assert not ends
    assert len(list(folder.iterdir())) == 3

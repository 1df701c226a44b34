"""The study of maps, on a small room: rows are counted rightly, kept, and held against the truth."""

from typing import Any

import pytest

from panoloc_mcl.laboratory.studies.mapping import cells
from panoloc_mcl.laboratory.studies.mapping.cells import Row
from panoloc_mcl.laboratory.studies.mapping.study import study
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.datasets import Dataset


@pytest.mark.parametrize("text", ["5cm", "drives:", "update:a", "update:a+b+c", "drive:a"])
def test_a_row_that_there_is_not(text: str) -> None:
    with pytest.raises(ConfigError, match=r"no such row; known: exact, 2cm.*update:BASE\+LATER"):
        Row.parsed(text)


def test_rows_say_which_drives_they_are_made_of() -> None:
    assert Row.parsed("drives:a+b").drives == ["a", "b"]
    assert Row.parsed("update:references+b").drives == ["references", "b"]
    assert Row.parsed("2cm").drives == []


@pytest.mark.slow
def test_surveys_drives_and_updates_become_rows_that_are_kept(
    small_room: Dataset, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path))
    kept: list[Any] = []
    config = RunConfig(dataset=str(small_room.path))
    rows = ["gross", f"drives:{next(iter(small_room.sequences))}"]
    report = study(config, rows, [0], 2, keep=kept.append)
    keyframes, images = report.data()["tables"]
    assert len(kept) == 2
    gross, driven = keyframes["rows"]
    assert gross["keyframes"] <= len(small_room.references)
    assert gross["wrong / named / kept wrong / blamed"].startswith("4 / ")
    assert driven["way, m"] > 0.0
    # The drive is not localized in the map that was made of it.
    assert [row["images"] for row in images["rows"]] == [len(next(iter(small_room.sequences.values()))) // 2]
    # Nothing is made twice.
    monkeypatch.setattr(cells, "_maps", None)
    assert study(config, rows, [0], 2).data() == report.data()

import json

import pytest

from panoloc_mcl.laboratory.studies.robustness.kills import damaged, study


def test_files_that_are_not_whole_are_found(tmp_path):
    (tmp_path / "whole.json").write_text("{}")
    (tmp_path / ".unfinished.json.abcdefgh").write_text("{")
    assert damaged(tmp_path) == []
    (tmp_path / "cut.json").write_text('{"a": ')
    (tmp_path / "cut.csv").write_text("a,b\n1,2\n3")
    (tmp_path / "cut.png").write_bytes(b"\x89PNG")
    (tmp_path / "cut.npz").write_bytes(b"PK\x03\x04")
    (tmp_path / "cut.html").write_text("<html><body>")
    (tmp_path / "cut.panomap").write_bytes(b"\x08\0\0")
    assert [path.suffix for path in damaged(tmp_path)] == [".csv", ".html", ".json", ".npz", ".panomap", ".png"]


@pytest.mark.slow
def test_a_few_kills():
    pytest.importorskip("mitsuba")
    report = study(kills=3, seed=1, commands=["build-map"])
    rows = json.loads(json.dumps(report.tables[0].data()))["rows"]
    assert sum(row["kills"] for row in rows) == 3
    assert sum(row["at work when killed"] for row in rows) > 0
    assert all(row["files not whole"] == 0 and row["finished"] == row["new starts"] > 0 for row in rows)

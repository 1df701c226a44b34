import json
import subprocess
import sys

import pytest

from panoloc_mcl.laboratory.studies.robustness import kills
from panoloc_mcl.laboratory.studies.robustness.kills import damaged, study

COMMANDS = {"quick": "pass", "slow": "import time; time.sleep(60)"}


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
    assert sum(row["killed at work"] for row in rows) == 3
    assert all(row["files not whole"] == 0 and row["finished"] == row["new starts"] > 0 for row in rows)


def test_a_kill_that_comes_too_late_does_not_count(tmp_path, monkeypatch):
    monkeypatch.setattr(kills, "_start", lambda name, work: subprocess.Popen([sys.executable, "-c", COMMANDS[name]]))
    assert not kills._killed("quick", tmp_path, 20.0)
    assert kills._killed("slow", tmp_path, 0.1)

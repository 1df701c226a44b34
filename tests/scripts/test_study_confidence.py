"""The study of confidence, small."""

import re

import pytest


@pytest.fixture(scope="module")
def study(load_script):
    return load_script("study_confidence")


@pytest.mark.slow
def test_the_table_holds_every_condition_and_all_of_them_together(study, own_cache, capsys: pytest.CaptureFixture[str]) -> None:
    assert study.main(["--dataset", "hall", "--conditions", "clean", "bars:0.5", "--every", "24"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"calibrated on \d+ images of held-out references", printed)
    rows = [line.split("|")[1].strip() for line in printed.splitlines() if line.startswith("|")]
    assert rows[2:] == ["clean", "bars:0.5", "all but foreign"]


def test_a_map_that_learns_nothing_says_which_setting(study, small_room, own_cache, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--dataset", str(small_room.path), "--set", "observation.votes.calibration_references=0"]
    assert study.main(words) == 2
    assert "observation.votes.calibration_references" in capsys.readouterr().err


def test_figures_of_a_condition(study) -> None:
    found = {"clean": [(0.9, True, False), (0.8, True, False)], "foreign": [(0.1, False, True), (0.2, False, True)]}
    clean, foreign, together = study.table(found)[2:]
    assert "| 100.0 % | 0.850 | 0.150 |" in clean
    assert "| 0.0 % | 0.150 | 0.150 |" in foreign
    assert "100.0 % (34.2 to 100.0)" in foreign
    assert together.split("|")[2].strip() == "2"

import pytest

from panoloc_mcl.laboratory.studies import confidence


@pytest.mark.slow
def test_the_table_holds_every_condition_and_all_of_them_together(ask, small_room):
    answer = ask("study", "confidence", "--dataset", small_room.path, "--conditions", "clean", "bars:0.5", "--every", "6")
    assert answer.code == 0
    assert "held-out references" in answer.report["title"]
    assert [row["images"] for row in answer.rows()] == ["clean", "bars:0.5", "all but foreign"]


@pytest.mark.slow
def test_a_map_that_learns_nothing_says_which_setting(ask, small_room):
    words = ["--dataset", small_room.path, "--set", "observation.votes.calibration_references=0"]
    answer = ask("study", "confidence", *words)
    assert (answer.code, answer.report) == (2, None)
    assert "observation.votes.calibration_references" in answer.err


def test_an_unknown_corruption_is_one_line(ask, small_room):
    answer = ask("study", "confidence", "--dataset", small_room.path, "--conditions", "bar:0.5")
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert "did you mean 'bars'?" in answer.err


@pytest.mark.slow
def test_figures_of_a_condition(ask, small_room, monkeypatch):
    known = {
        "clean": [("a", 0.9, True, False), ("b", 0.8, True, False)],
        "foreign": [("c", 0.1, False, True), ("d", 0.2, False, True)],
    }
    monkeypatch.setattr(confidence, "judged", lambda _config, _foreign, _every, condition: known[condition])
    words = ["--dataset", small_room.path, "--conditions", "clean", "--foreign", small_room.path]
    clean, foreign, together = ask("study", "confidence", *words).rows()
    assert clean["right"]["rate"] == 1.0
    assert clean["mean confidence"] == pytest.approx(0.85)
    assert clean["ECE"] == pytest.approx(0.15)
    assert foreign["right"]["rate"] == 0.0
    # Two drives of which every image fits nowhere: Wilson's interval of 2 of 2.
    assert foreign["fit nowhere (95 %)"]["interval95"] == pytest.approx([0.342, 1.0], abs=1e-3)
    assert together["n"] == 2

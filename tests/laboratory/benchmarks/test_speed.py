"""The benchmarks that are quick on a small room: they give ratios to their peers."""

import pytest


@pytest.mark.slow
def test_one_image_against_template_matching(ask, small_room):
    answer = ask("benchmark", "speed", "--dataset", small_room.path, "--repeats", "2")
    rows = {row["what"]: row["time / template matching (95 %)"] for row in answer.rows()}
    assert rows["cv2.matchTemplate"]["ratio"] == 1.0
    assert rows["pixels to pose, all of it"]["ratio"] > rows["pixels to vote field, without virtual places"]["ratio"] > 0.0
    assert rows["pixels to pose, all of it"]["rounds"] == 2


@pytest.mark.slow
def test_where_the_time_of_an_image_goes(ask, small_room, tmp_path):
    answer = ask("benchmark", "profile", "--dataset", small_room.path, "--out", tmp_path)
    for rows in (answer.rows(0), answer.rows(1)):
        spent = {row["stage"]: row["ms an image"] for row in rows}
        whole = spent.pop("all")
        assert sum(spent.values()) == pytest.approx(whole, rel=0.01)
        # Every stage is found under its name, and hardly anything is in none.
        assert all(
            spent[stage] > 0.0 for stage in spent if stage not in {"the rest", "votes at a glance", "votes of all places"}
        )
        assert abs(spent["the rest"]) < 0.5 * whole
    assert (tmp_path / "profile.png").stat().st_size > 5_000


@pytest.mark.slow
def test_the_filter_against_numpy(ask):
    answer = ask("benchmark", "filter", "--particles", "2000", "--repeats", "5")
    rows = {row["what"]: row for row in answer.rows()}
    assert rows["NumPy, float64"]["faster than NumPy, clock (95 %)"]["ratio"] == 1.0
    assert rows["this filter"]["clock: ns a particle"] > 0.0
    assert "bytes a particle" in answer.report["title"]


@pytest.mark.slow
def test_the_paper_s_voting_against_numpy(ask, hall):
    answer = ask("benchmark", "voting", "--dataset", hall, "--repeats", "1")
    assert answer.rows()[0]["times as long as the kernel (95 %)"]["ratio"] == 1.0
    assert len(answer.rows(0)) == len(answer.rows(1)) == 4

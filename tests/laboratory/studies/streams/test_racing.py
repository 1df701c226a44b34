import pytest


@pytest.mark.slow
def test_it_is_told_in_tables(ask, small_room) -> None:
    answer = ask("study", "racing", "--dataset", small_room.path, "--seconds", "3")
    assert answer.code == 0
    assert answer.report["facts"]["status"] == "converged", answer
    assert [row["thread"] for row in answer.rows()] == ["odometry", "images", "questions", "orders"]
    assert all(row["failures"] == 0 and row["calls"] > 0 for row in answer.rows())

import pytest


@pytest.mark.slow
def test_workers_give_the_same_tables(ask, small_room):
    pytest.importorskip("distributed")
    answer = ask("benchmark", "workers", "--dataset", small_room.path, "--workers", "1", "--seeds", "1", "--repeats", "1")
    assert answer.code == 0
    assert answer.report["facts"] == {"same": True}
    assert answer.report["title"].startswith("2 cells of `room`, 1 rounds")
    assert [row["engine"] for row in answer.rows()] == ["one process", "1 local workers"]


def test_faults_are_one_line(ask):
    answer = ask("benchmark", "workers", "--dataset", "nowhere")
    assert (answer.code, answer.report) == (2, None)
    assert answer.err.count("\n") == 1

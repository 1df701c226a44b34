import pytest


@pytest.mark.slow
def test_workers_give_the_same_tables(load_script, small_room, own_cache, capsys):
    pytest.importorskip("distributed")
    script = load_script("benchmark_compare")
    assert script.main(["--dataset", str(small_room.path), "--workers", "1", "--seeds", "1", "--repeats", "1"]) == 0
    out = capsys.readouterr().out
    assert "2 cells of `room`, 1 rounds." in out
    assert "Tables: the same to the last byte." in out


def test_faults_are_one_line(load_script, capsys):
    script = load_script("benchmark_compare")
    assert script.main(["--dataset", "nowhere"]) == 2
    assert capsys.readouterr().err.count("\n") == 1

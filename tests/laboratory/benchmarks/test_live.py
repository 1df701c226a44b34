import pytest


@pytest.mark.slow
def test_latency_memory_poses_and_a_long_recording(ask, small_room) -> None:
    answer = ask("benchmark", "live", "--dataset", small_room.path, "--seconds", "3", "--images", "5", "--megabytes", "5")
    assert answer.code == 0
    facts = answer.report["facts"]
    played, read = facts["played"], facts["read"]
    assert 10 <= played["came"] <= 17
    assert played["answered"] + played["dropped"] == played["came"]
    assert played["latency_ms"] >= played["step_ms"] > 0.0
    assert played["processor_ms"] > 0.0
    for one in read.values():
        assert one["size_mb"] > 4.0
        assert one["images"] > 100
    assert facts["asked"]["median_us"] < 1000.0

import json
import shutil
import subprocess

import numpy as np
import pytest

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.tools.datasets.trajectory import Trajectory, write_tum
from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate, wilson95

PLACES = [[0.0, 0.0], [1.0, 0.0]]

KEYS = {
    "frames": None,
    "runs": None,
    "ape_rmse_m": None,
    "position_rmse_m": None,
    "position_mean_m": None,
    "position_median_m": None,
    "position_p95_m": None,
    "heading_median_deg": None,
    "heading_p95_deg": None,
    "within": {"0.10m_1deg", "0.25m_2deg", "0.50m_5deg", "1.00m_10deg"},
    "recognition": {"passed", "recognised", "rate", "wilson95"},
    "global_success": {"runs", "succeeded", "rate", "wilson95"},
    "false_convergence": {"runs", "count", "rate"},
    "frames_to_converge_median": None,
    "seconds_to_converge_median": None,
    "tracks_lost": None,
    "kidnap": {"events", "recovered", "rate", "wilson95", "frames_to_recover_median"},
    "consistency": {"position", "heading"},
    "step_ms": {"median", "p95"},
}


def overall(*records, places=PLACES):
    return evaluate(records, places)["overall"]


def leaves(figures):
    for value in figures.values():
        yield from leaves(value) if isinstance(value, dict) else [value]


def test_keys_are_those_of_the_contract(make_record):
    metrics = evaluate([make_record("c"), make_record("s", name="evening_00", with_truth=False)], PLACES)
    assert list(metrics) == ["schema", "overall", "groups", "sequences"]
    assert metrics["schema"] == "panoloc-metrics/1"
    assert set(metrics["groups"]) == {"noon", "evening"}
    assert set(metrics["sequences"]) == {"noon_00", "evening_00"}
    for figures in [metrics["overall"], *metrics["groups"].values(), *metrics["sequences"].values()]:
        assert list(figures) == list(KEYS)
        for key, inner in KEYS.items():
            if inner is not None:
                assert set(figures[key]) == inner
    json.dumps(metrics, allow_nan=False)


def test_errors_after_convergence_and_over_all_frames(make_record):
    figures = overall(make_record("scac", metres=[3.0, 0.0, 0.3, 0.4], degrees=[90, 1, -2, 3]))
    assert figures["ape_rmse_m"] == pytest.approx(np.sqrt((9 + 0.09 + 0.16) / 4))
    assert figures["position_rmse_m"] == pytest.approx(np.sqrt(0.25 / 3))
    assert figures["position_mean_m"] == pytest.approx(0.7 / 3)
    assert figures["position_median_m"] == pytest.approx(0.3)
    assert figures["position_p95_m"] == pytest.approx(0.39)
    assert figures["heading_median_deg"] == pytest.approx(2.0)
    assert figures["heading_p95_deg"] == pytest.approx(2.9)


def test_within_counts_what_lies_on_the_limit(make_record):
    # 1.1 - 1.0 is a little more than 0.1 in floating point.
    record = make_record("sssss", metres=[0.1, 0.25, 0.5, 1.0, 0.0], degrees=[1.0, -2.0, 5.0, 10.0, 10.1], truth_x=1.0)
    assert overall(record)["within"] == pytest.approx(
        {"0.10m_1deg": 0.2, "0.25m_2deg": 0.4, "0.50m_5deg": 0.6, "1.00m_10deg": 0.8}
    )


def test_never_converged(make_record):
    figures = overall(make_record("ssas", metres=2.0))
    for key in ("position_rmse_m", "position_mean_m", "position_median_m", "position_p95_m", "heading_median_deg"):
        assert figures[key] is None
    assert figures["ape_rmse_m"] == pytest.approx(2.0)
    assert figures["frames_to_converge_median"] is None
    assert figures["seconds_to_converge_median"] is None
    assert figures["tracks_lost"] is None
    assert figures["recognition"] == {"passed": 0, "recognised": 0, "rate": None, "wilson95": None}
    assert figures["global_success"] == {"runs": 1, "succeeded": 0, "rate": 0.0, "wilson95": list(wilson95(0, 1) or ())}
    assert figures["false_convergence"] == {"runs": 1, "count": 0, "rate": 0.0}


def test_without_truth_only_what_needs_none_is_given(make_record):
    figures = overall(make_record("ssc", with_truth=False, kidnapped=[2], step_ms=[1.0, 2.0, 4.0]))
    assert figures.pop("frames") == 3
    assert figures.pop("runs") == 1
    assert figures.pop("frames_to_converge_median") == 3
    assert figures.pop("seconds_to_converge_median") == pytest.approx(2.0)
    assert figures.pop("step_ms") == pytest.approx({"median": 2.0, "p95": 3.8})
    assert list(leaves(figures)) == [None] * len(list(leaves(figures)))


def test_recognition_counts_frames_after_convergence_near_a_place(make_record):
    record = make_record(
        "sccccccc",
        truth_x=[0.0, 0.0, 0.15, 0.151, 0.86, 1.0, 0.5, 1.1],
        best_place=[0, 0, 0, 0, 1, 0, 0, -1],
    )
    # Not yet converged; recognised; recognised at the limit; outside; recognised; wrong; outside; none named.
    recognition = overall(record)["recognition"]
    assert (recognition["passed"], recognition["recognised"]) == (5, 3)
    assert recognition["rate"] == pytest.approx(0.6)
    # Three of five images of one drive say next to nothing of other drives.
    assert recognition["wilson95"] == [0.0, 1.0]


def test_places_at_one_spot_are_one_place(make_record):
    record = make_record("cc", truth_x=0.1, best_place=[0, 1])
    assert overall(record, places=[[0.0, 0.0], [0.0, 0.0]])["recognition"]["recognised"] == 2


@pytest.mark.parametrize("places", [None, [], np.zeros((0, 2))])
def test_recognition_does_not_apply_without_places(make_record, places):
    assert set(overall(make_record("cc"), places=places)["recognition"].values()) == {None}


def test_recognition_does_not_apply_to_runs_that_never_name_a_place(make_record):
    silent = make_record("cc", best_place=-1)
    assert set(overall(silent)["recognition"].values()) == {None}
    assert overall(silent, make_record("cc", run=1))["recognition"]["passed"] == 2


def test_pooling_is_over_frames_for_errors_and_over_runs_for_rates(make_record):
    short = make_record("cc", metres=0.4, dt=3.0)
    long = make_record("scccccc", metres=[5.0] + [0.1] * 6, run=1)
    figures = overall(short, long)
    assert (figures["frames"], figures["runs"]) == (9, 2)
    assert figures["position_mean_m"] == pytest.approx((2 * 0.4 + 6 * 0.1) / 8)
    assert figures["position_median_m"] == pytest.approx(0.1)
    assert figures["ape_rmse_m"] == pytest.approx(np.sqrt((2 * 0.16 + 25 + 6 * 0.01) / 9))
    assert figures["global_success"]["rate"] == 1.0
    assert figures["frames_to_converge_median"] == 1.5
    assert figures["seconds_to_converge_median"] == pytest.approx(0.5)


def test_groups_and_sequences_pool_their_own(make_record):
    records = [
        make_record("cc", 0.1, name="noon_00"),
        make_record("cc", 0.3, name="noon_00", run=1),
        make_record("cc", 0.5, name="noon_01"),
        make_record("cc", 0.7, name="evening_00"),
    ]
    metrics = evaluate(records, PLACES)
    means = {name: figures["position_mean_m"] for name, figures in metrics["sequences"].items()}
    assert means == pytest.approx({"evening_00": 0.7, "noon_00": 0.2, "noon_01": 0.5})
    assert metrics["groups"]["noon"]["position_mean_m"] == pytest.approx(0.3)
    assert metrics["groups"]["noon"]["runs"] == 3
    assert metrics["overall"]["position_mean_m"] == pytest.approx(0.4)


def test_the_order_of_the_records_does_not_matter(make_record):
    rng = np.random.default_rng(1)
    records = [make_record("scccc", rng.random(5), name=f"noon_0{i}", run=r) for i in range(3) for r in range(2)]
    assert evaluate(records, PLACES) == evaluate(records[::-1], PLACES)


def test_a_run_that_never_converges_is_later_than_all_others(make_record):
    runs = [make_record("c"), make_record("ssc", run=1), make_record("sss", run=2)]
    assert overall(*runs)["frames_to_converge_median"] == 3
    assert overall(*runs[:1], runs[2])["frames_to_converge_median"] is None


def test_kidnaps(make_record):
    back = make_record("cc" + "s" * 6, [0, 0, 2, 2, 0.1, 0.1, 0.1, 0.1], kidnapped=[2])
    at_once = make_record("cc" + "s" * 6, 0.0, kidnapped=[2], run=1)
    never = make_record("cc" + "s" * 6, [0, 0] + [2] * 6, kidnapped=[2], run=2)
    kidnap = overall(back, at_once, never)["kidnap"]
    assert (kidnap["events"], kidnap["recovered"]) == (3, 2)
    assert kidnap["rate"] == pytest.approx(2 / 3)
    # Three runs over the same teleport: one trial, on which the runs disagree.
    assert kidnap["wilson95"] == [0.0, 1.0]
    others = [make_record("ccc" + "s" * 5, 0.0, kidnapped=[2], name=f"noon_{k:02}") for k in range(3)]
    assert overall(*others)["kidnap"]["wilson95"] == pytest.approx(wilson95(3, 3))
    assert kidnap["frames_to_recover_median"] == 3


def test_without_kidnaps_their_figures_are_null(make_record):
    assert set(overall(make_record("ccc"))["kidnap"].values()) == {None}


def test_false_convergence_counts_runs(make_record):
    figures = overall(make_record("cccc", 2.0), make_record("cccc", 0.0, run=1))
    assert figures["false_convergence"] == {"runs": 2, "count": 1, "rate": 0.5}


def test_tracks_lost_are_summed_over_runs(make_record):
    lost = np.r_[np.zeros(3), np.full(5, 2.0)]
    assert overall(make_record("c" * 8, lost), make_record("c" * 8, lost, run=1))["tracks_lost"] == 2
    assert overall(make_record("c" * 8))["tracks_lost"] == 0


def test_steps_that_were_not_measured_are_left_out(make_record):
    assert overall(make_record("ccc", step_ms=[1.0, np.nan, 3.0]))["step_ms"]["median"] == 2.0
    assert overall(make_record("c", step_ms=np.nan))["step_ms"] == {"median": None, "p95": None}


def test_faults(make_record):
    with pytest.raises(ResultsError, match="no runs to evaluate"):
        evaluate([], PLACES)
    with pytest.raises(ResultsError, match="'noon_00', run 0: given twice"):
        evaluate([make_record("c"), make_record("c")], PLACES)
    with pytest.raises(ResultsError, match="best_place 2 is not among the 2 places"):
        evaluate([make_record("c", best_place=2)], PLACES)
    with pytest.raises(ResultsError, match=r"place_positions has shape \(2, 3\)"):
        evaluate([make_record("c")], np.zeros((2, 3)))


@pytest.mark.skipif(shutil.which("evo_ape") is None, reason="evo is not installed")
def test_ape_is_that_of_evo(tmp_path, monkeypatch):
    rng = np.random.default_rng(7)
    n = 60
    truth = np.column_stack([rng.normal(0, 3, (n, 2)).cumsum(axis=0), rng.uniform(-np.pi, np.pi, n)])
    record = SequenceRecord(
        name="noon_00",
        run=0,
        times=(1.6e9 + 0.13 * np.arange(n)).astype(np.float64),
        poses=truth + rng.normal(0, 0.5, (n, 3)),
        truth=truth,
        status=("searching",) * n,
        best_place=np.full(n, -1),
        step_ms=np.ones(n),
        kidnapped=np.zeros(n, dtype=bool),
    )
    write_tum(tmp_path / "truth.tum", Trajectory(record.times, truth))
    write_tum(tmp_path / "estimate.tum", Trajectory(record.times, record.poses))
    # evo keeps settings in the home folder.
    monkeypatch.setenv("HOME", str(tmp_path))
    out = subprocess.run(
        ["evo_ape", "tum", "truth.tum", "estimate.tum"], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120
    ).stdout
    rmse = next(float(line.split()[1]) for line in out.splitlines() if line.split()[:1] == ["rmse"])
    assert evaluate([record], None)["overall"]["ape_rmse_m"] == pytest.approx(rmse, abs=1e-6)

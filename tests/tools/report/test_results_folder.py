import json
import os
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.tools.evaluation import evaluate
from panoloc_mcl.tools.report import ResultsWriter, read_results


def test_layout(finished):
    path, _ = finished
    files = {str(file.relative_to(path)) for file in path.rglob("*") if file.is_file()}
    assert path.name == "20240506_070809"
    assert files == {
        "config.yaml",
        "run.json",
        "places.csv",
        "summary.md",
        "report.html",
        "metrics.json",
        "noon_00/run_0/trajectory.tum",
        "noon_00/run_0/groundtruth.tum",
        "noon_00/run_0/steps.csv",
        "noon_00/run_1/trajectory.tum",
        "noon_00/run_1/groundtruth.tum",
        "noon_00/run_1/steps.csv",
        "evening_00/run_0/trajectory.tum",
        "evening_00/run_0/steps.csv",
    }
    assert json.loads((path / "metrics.json").read_text())["schema"] == "panoloc-metrics/1"


def test_what_is_read_back_gives_the_same_figures(finished):
    path, metrics = finished
    results = read_results(path)
    assert evaluate(results.records, results.place_positions) == metrics == results.metrics
    assert results.config == {"dataset": "hall", "seed": 0}
    assert results.run_info["model"] == "votes"
    assert results.place_files == ("a.png", "b,1.png", "")


def test_figures_hardly_depend_on_the_rounding_of_files(make_record, finished, places):
    _, metrics = finished
    exact = evaluate([make_record(), make_record(run=1, kidnapped_at=12), make_record("evening_00", with_truth=False)], places)
    assert metrics["overall"]["ape_rmse_m"] == pytest.approx(exact["overall"]["ape_rmse_m"], abs=1e-8)


def test_latest_points_to_the_newest_whole_run(finished, tmp_path):
    path, metrics = finished
    root = tmp_path / "results"
    assert (root / "hall" / "latest").resolve() == path.resolve()
    unfinished = ResultsWriter(root, "hall", datetime(2025, 1, 1))
    assert (root / "hall" / "latest").resolve() == path.resolve()
    unfinished.finish(metrics, summary="", report="")
    assert (root / "hall" / "latest").resolve() == unfinished.path.resolve()
    assert read_results(path).path == path.resolve()


def test_latest_is_a_text_file_where_links_are_not_possible(unfinished, places, monkeypatch):
    def refuse(*_, **__):
        raise OSError("links are not possible here")

    monkeypatch.setattr(Path, "symlink_to", refuse)
    writer, records = unfinished
    path = writer.finish(evaluate(records, places), summary="", report="")
    latest = path.parent / "latest"
    assert latest.is_file()
    assert not latest.is_symlink()
    assert read_results(latest).path == path.resolve()


def test_a_folder_called_latest_is_not_overwritten(unfinished, places):
    writer, records = unfinished
    (writer.path.parent / "latest" / "precious").mkdir(parents=True)
    with pytest.raises(ResultsError, match=r"latest: cannot be pointed to 20240506_070809 .*the results are whole"):
        writer.finish(evaluate(records, places), summary="", report="")
    assert sorted(entry.name for entry in writer.path.parent.iterdir()) == ["20240506_070809", "latest"]


def test_runs_within_a_second_get_folders_of_their_own(tmp_path, started):
    names = [ResultsWriter(tmp_path, "hall", started).path.name for _ in range(3)]
    assert names == ["20240506_070809", "20240506_070809_2", "20240506_070809_3"]


def test_steps_hold_the_record_and_the_stages(tmp_path, started, make_record):
    writer = ResultsWriter(tmp_path, "hall", started)
    record = make_record(n=3)
    rows: list[dict[str, object]] = [
        {"message": "two\nlines, and a comma", "particles": 10, "resampled": True, "margin": np.nan, "status": "nonsense"},
        {"ms_score": 1.5, "n_eff": np.float64(2.5), "injected": np.int64(3)},
        {"ms_score": 2.5, "ms_filter": None, "ms_total": 1e9},
    ]
    writer.write_run(record, rows)
    lines = (writer.path / "noon_00/run_0/steps.csv").read_text().splitlines()
    assert lines[0] == (
        "timestamp,status,message,particles,n_eff,spread_m,spread_deg,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt,"
        "best_place,best_place_votes,margin,"
        "resampled,injected,kidnapped,ms_score,ms_filter,ms_total"
    )
    assert lines[1].startswith(
        f'{record.times[0]:.9f},searching,"two lines, and a comma",10,,,,,,,,,,{record.best_place[0]},,,1,,0,,,'
    )
    assert lines[2].split(",")[4] == "2.5"
    assert lines[2].split(",")[17] == "3"
    assert lines[3].endswith(f",2.5,,{float(record.step_ms[2])!r}")


def test_unknown_columns_and_missing_rows_are_refused(tmp_path, started, make_record):
    writer = ResultsWriter(tmp_path, "hall", started)
    with pytest.raises(ValueError, match="row 1 of the steps: unknown column 'partcles'"):
        writer.write_run(make_record(n=3), [{}, {"partcles": 1}, {}])
    with pytest.raises(ValueError, match="2 rows of steps for 3 frames"):
        writer.write_run(make_record(n=3), [{}, {}])


def test_unmeasured_steps_come_back(tmp_path, started, make_record):
    record = make_record(n=3)
    record.step_ms[1] = np.nan
    back = ResultsWriter(tmp_path, "hall", started).write_run(record, [{}] * 3)
    np.testing.assert_array_equal(back.step_ms, record.step_ms)


def test_run_info_is_strict_json(tmp_path, started):
    writer = ResultsWriter(tmp_path, "hall", started)
    writer.write_run_info(
        {"load": float("nan"), "seeds": np.arange(2), "where": Path("a"), "at": started, "on": np.bool_(True), "t": (1, 2.5)}
    )
    assert json.loads((writer.path / "run.json").read_text()) == {
        "format": "panoloc-results/1",
        "load": None,
        "seeds": [0, 1],
        "where": "a",
        "at": "2024-05-06T07:08:09",
        "on": True,
        "t": [1, 2.5],
    }


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "a\\b", ".hidden", "a\nb", "latest"])
def test_names_that_are_no_folder_names_are_refused(tmp_path, started, name):
    with pytest.raises(ResultsError, match="name of the results"):
        ResultsWriter(tmp_path, name, started)


def test_a_file_in_the_way_gives_one_line(tmp_path, started):
    (tmp_path / "hall").write_text("in the way")
    with pytest.raises(ResultsError, match="hall") as caught:
        ResultsWriter(tmp_path, "hall", started)
    assert len(caught.value.faults) == 1
    with pytest.raises(ResultsError, match="choose another folder with --out"):
        ResultsWriter(tmp_path / "hall", "x", started)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs permissions that bind")
def test_an_unwritable_root_gives_one_line(tmp_path, started):
    tmp_path.chmod(0o500)
    with pytest.raises(ResultsError, match="cannot be made"):
        ResultsWriter(tmp_path, "hall", started)
    tmp_path.chmod(0o700)


def test_a_folder_that_vanished_gives_one_line(tmp_path, started):
    writer = ResultsWriter(tmp_path, "hall", started)
    writer.path.rmdir()
    writer.path.write_text("a file now")
    with pytest.raises(ResultsError, match=r"config.yaml: cannot be written .*--out"):
        writer.write_config({"seed": 0})

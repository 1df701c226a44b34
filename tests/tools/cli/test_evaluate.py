import json
import shutil

import pytest


@pytest.fixture
def results(full_run, tmp_path):
    """A copy of a results folder that a test may change."""
    return shutil.copytree(full_run.folder, tmp_path / "results")


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_figures_come_out_the_same_and_nothing_is_written(panoloc, results, full_run):
    before = contents(results)
    done = panoloc("evaluate", results)
    assert done.code == 0
    assert done.err == ""
    assert done.folder == results
    assert done.lines[:-1] == full_run.lines[:-1]
    assert contents(results) == before


def test_writing_them_again_changes_nothing(panoloc, results):
    before = contents(results)
    assert panoloc("evaluate", results, "--write").code == 0
    assert contents(results) == before


def test_other_figures_are_noticed_and_replaced_only_when_asked(panoloc, results):
    path = results / "metrics.json"
    right = path.read_text()
    wrong = json.loads(right)
    wrong["overall"]["ape_rmse_m"] = 0.0
    path.write_text(json.dumps(wrong))
    done = panoloc("evaluate", results)
    assert done.err == f"note: {results}: metrics.json holds other figures; write these with --write\n"
    assert json.loads(path.read_text()) == wrong
    assert panoloc("evaluate", results, "--write").code == 0
    assert path.read_text() == right


def test_latest_will_do(panoloc, full_run):
    assert panoloc("evaluate", full_run.folder.parent / "latest").folder == full_run.folder.resolve()


def test_what_is_no_results_folder(panoloc, tmp_path, results):
    (tmp_path / "empty").mkdir()
    (results / "metrics.json").unlink()
    for path, what in (
        (tmp_path / "none", "no such folder"),
        (tmp_path / "empty", "is not a results folder"),
        (results, "did not finish"),
    ):
        done = panoloc("evaluate", path)
        assert done.code == 2
        (line,) = done.err.splitlines()
        assert what in line
        assert done.out == ""


@pytest.fixture
def foreign(full_run, tmp_path):
    """A trajectory and its truth, as another program may have left them: with rates of their own."""
    run = full_run.folder / "noon_00" / "run_0"
    for name in ("trajectory.tum", "groundtruth.tum"):
        shutil.copy(run / name, tmp_path / name)
    return tmp_path / "trajectory.tum", tmp_path / "groundtruth.tum"


def test_a_foreign_trajectory_has_the_errors_that_evo_gives(panoloc, foreign, full_run):
    estimate, truth = foreign
    done = panoloc("evaluate", estimate, "--groundtruth", truth, "--json")
    assert done.code == 0
    found = json.loads(done.out)["metrics"]["overall"]
    own = json.loads((full_run.folder / "metrics.json").read_text())["sequences"]["noon_00"]
    steps = (full_run.folder / "noon_00" / "run_0" / "steps.csv").read_text()
    for name in ("frames", "ape_rmse_m", "within", "tracks_lost"):
        assert found[name] == own[name], (name, full_run, steps)
    assert found["frames_to_converge_median"] is None
    assert found["global_success"]["rate"] is None
    assert found["recognition"]["rate"] is None
    assert "APE, RMSE" in panoloc("evaluate", estimate, "--groundtruth", truth).out


def test_poses_without_truth_are_left_out(panoloc, foreign):
    estimate, truth = foreign
    lines = truth.read_text().splitlines(keepends=True)
    truth.write_text("".join(lines[:-5]))
    done = panoloc("evaluate", estimate, "--groundtruth", truth)
    assert done.code == 0
    assert "5 of 20 poses left out" in done.err


def test_foreign_files_that_do_not_fit(panoloc, foreign, results):
    estimate, truth = foreign
    other = estimate.with_name("other.tum")
    other.write_text("1e9 0 0 0 0 0 0 1\n")
    for words, what in (
        ((estimate,), "--groundtruth FILE"),
        ((results, "--groundtruth", truth), "has its own truth"),
        ((estimate, "--groundtruth", truth, "--write"), "--write"),
        ((estimate, "--groundtruth", other), "nothing in common"),
        ((estimate, "--groundtruth", estimate.with_name("none.tum")), "no such file"),
    ):
        done = panoloc("evaluate", *words)
        assert done.code == 2
        (line,) = done.err.splitlines()
        assert what in line

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

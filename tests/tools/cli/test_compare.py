from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture
def compare(panoloc, small_room, tmp_path):
    """Compare over the small room, a few frames."""

    def call(*words):
        common = ("--set", f"datasets=['{small_room}']", "--set", "frames=3", "--out", tmp_path / "out")
        return panoloc("compare", *words, *common)

    return call


@pytest.mark.slow
def test_a_shipped_matrix_from_the_command_line(compare, tmp_path):
    sets = [f"--set={one}" for one in ("seeds=1", "baseline=null", "observations=[orientation_correlation]")]
    words = (CONFIGS / "compare_references.yaml", "--no-plots", *sets)
    done = compare(*words)
    assert done.code == 0
    assert done.folder == tmp_path / "out" / "compare_references"
    assert "## Ranking" in done.out
    assert "cells: 3/3" in done.err
    assert (done.folder / "table.csv").read_text().count("\n") == 4
    again = compare(*words)
    assert again.code == 0
    assert "cells:" not in again.err
    assert again.out == done.out


def test_runs_side_by_side(panoloc, small_room, tmp_path):
    words = [CONFIGS / "global.yaml", CONFIGS / "track.yaml", "--set", f"dataset={small_room}", "--out", tmp_path / "out"]
    done = panoloc("compare", *words)
    assert done.code == 0
    assert done.folder.name == "global_vs_track"
    assert "| noon | track | 1 |" in done.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "observations=[vote]"), "observations.vote: observation.model = 'vote': must be"),
        (("--set", "seeds=[]"), "seeds = []"),
        (("--set", "lights=[midnight]"), "'midnight' fits no group of sequences"),
        (("--set", "seed=3"), "unknown key 'seed'; did you mean 'seeds'?"),
        (("--workers", "0"), "--workers 0"),
        (("--set", "datasets=[nowhere]"), "dataset = 'nowhere'"),
    ],
)
def test_faults_are_one_line_and_code_2(panoloc, small_room, tmp_path, words, said):
    words = ["--set", f"datasets=['{small_room}']", "--out", tmp_path / "out", *words]
    done = panoloc("compare", CONFIGS / "compare_references.yaml", *words)
    assert done.code == 2
    assert done.out == ""
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_file_that_there_is_not(panoloc):
    done = panoloc("compare", "nothing.yaml")
    assert (done.code, done.err) == (2, "nothing.yaml: no such file; check the path\n")

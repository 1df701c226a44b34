import json
import math
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl import load_config
from panoloc_mcl.tools.config import config_to_yaml
from panoloc_mcl.tools.datasets import read_tum
from panoloc_mcl.tools.report.pages.plotly_script import can_plot

CONFIGS = Path(__file__).parents[3] / "configs"
SEQUENCES = ("afternoon_00", "evening_00", "noon_00", "people_00")


@pytest.fixture(scope="module")
def metrics(full_run):
    return json.loads((full_run.folder / "metrics.json").read_text())


def test_it_succeeds_and_the_path_comes_last(full_run):
    assert full_run.code == 0, full_run.err
    assert full_run.folder.is_dir()
    assert (full_run.folder.parent / "latest").resolve() == full_run.folder.resolve()
    assert "Figures by group" in full_run.out
    assert "Beside Table 2" not in full_run.out
    # Without plotly, a last line says that the report has no player.
    assert full_run.err.splitlines()[-1 if can_plot() else -2] == "images: 80/80"
    assert "\x1b" not in full_run.out + full_run.err


def test_the_folder_holds_what_it_promises(full_run):
    for name in ("config.yaml", "run.json", "metrics.json", "summary.md", "report.html", "places.csv"):
        assert (full_run.folder / name).stat().st_size > 0
    for sequence in SEQUENCES:
        for name in ("trajectory.tum", "groundtruth.tum", "steps.csv"):
            assert (full_run.folder / sequence / "run_0" / name).stat().st_size > 0
    resolved = load_config(full_run.folder / "config.yaml")
    assert config_to_yaml(resolved) == (full_run.folder / "config.yaml").read_text()
    info = json.loads((full_run.folder / "run.json").read_text())
    assert info["seed"] == 0
    assert info["command"][:2] == ["panoloc", "run"]
    assert {"versions", "machine", "threads"} <= set(info)


def test_the_robot_finds_itself(metrics):
    assert set(metrics["groups"]) == {"noon", "afternoon", "evening", "people"}
    overall = metrics["overall"]
    assert overall["frames"] == 80
    assert all(group["global_success"]["rate"] == 1.0 for group in (overall, *metrics["groups"].values()))
    assert overall["tracks_lost"] == 0
    assert overall["position_median_m"] < 0.3
    assert overall["heading_median_deg"] < 3.0
    assert overall["kidnap"]["rate"] is None
    assert 0.0 < overall["step_ms"]["median"] < 1000.0


def test_positions_in_the_files_are_those_in_the_figures(full_run, metrics):
    for sequence in SEQUENCES:
        folder = full_run.folder / sequence / "run_0"
        poses, truth = (read_tum(folder / name).poses for name in ("trajectory.tum", "groundtruth.tum"))
        rmse = math.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1)))
        assert metrics["sequences"][sequence]["ape_rmse_m"] == pytest.approx(rmse, abs=1e-9)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_evo_says_the_same(full_run, metrics, sequence, tmp_path):
    program = Path(sys.executable).with_name("evo_ape")
    if not program.exists():
        pytest.skip("evo is not installed")
    folder = full_run.folder / sequence / "run_0"
    done = subprocess.run(
        [program, "tum", folder / "groundtruth.tum", folder / "trajectory.tum", "--save_results", tmp_path / "ape.zip"],
        capture_output=True,
        text=True,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with zipfile.ZipFile(tmp_path / "ape.zip") as results:
        rmse = json.loads(results.read("stats.json"))["rmse"]
    assert metrics["sequences"][sequence]["ape_rmse_m"] == pytest.approx(rmse, abs=1e-6)


@pytest.mark.parametrize("threads", ["1", "2"])
@pytest.mark.parametrize("config", ["global", pytest.param("kalman", marks=pytest.mark.slow)])
def test_the_same_seed_gives_the_same_bytes(config, threads, full_run, panoloc_process, panoloc, tmp_path):
    """On a second run, with any number of threads, and whichever sequences are run with it."""
    words = ("run", CONFIGS / f"{config}.yaml", "--set", "sequences=[evening_00]", "--out", tmp_path / "a")
    again = panoloc_process(*words, cwd=tmp_path, NUMBA_NUM_THREADS=threads, OMP_NUM_THREADS=threads)
    first = full_run if config == "global" else panoloc(*words)
    one, other = (done.folder / "evening_00" / "run_0" / "trajectory.tum" for done in (first, again))
    assert one.read_bytes() == other.read_bytes()


def test_a_run_is_repeated_from_its_run_json(run_small, panoloc):
    first = run_small("--seed", 5)
    again = panoloc("run", first.folder / "run.json")
    assert again.code == 0, again.err
    assert again.folder != first.folder
    assert f"note: 1 of 1 trajectories have the same bytes as in {first.folder.resolve()}" in again.err.splitlines()
    other = panoloc("run", first.folder / "run.json", "--seed", 6)
    assert "note: 0 of 1 trajectories" in other.err


def test_a_run_json_of_other_versions_is_repeated_with_a_word(run_small, panoloc):
    done = run_small()
    info = json.loads((done.folder / "run.json").read_text())
    info["versions"]["numpy"] = "1.0.0"
    (done.folder / "run.json").write_text(json.dumps(info))
    again = panoloc("run", done.folder / "run.json")
    assert "made with other versions (numpy 1.0.0, now " in again.err
    (done.folder / "run.json").write_text(json.dumps(info | {"format": "panoloc-results/2"}))
    newer = panoloc("run", done.folder / "run.json")
    assert newer.code == 2
    assert "newer than 'panoloc-results/1'; upgrade panoloc-mcl" in newer.err


def test_another_seed_gives_another_run_and_runs_count_up_from_the_seed(run_small):
    twice = run_small("--seed", 5, "--set", "runs=2")
    once = run_small("--seed", 6)
    first, second = (twice.folder / "noon_00" / f"run_{i}" / "trajectory.tum" for i in (0, 1))
    assert first.read_bytes() != second.read_bytes()
    assert second.read_bytes() == (once.folder / "noon_00" / "run_0" / "trajectory.tum").read_bytes()


def test_options_beat_set_and_set_beats_the_file(run_small):
    done = run_small("--set", "seed=3", "--set", "name=mine", "--seed", 4)
    config = load_config(done.folder / "config.yaml")
    assert (config.seed, config.name) == (4, "mine")
    assert done.folder.parent.name == "mine"


@pytest.mark.slow
def test_a_built_map_gives_the_same_as_the_references(run_small, built):
    assert built.code == 0
    assert built.lines == ["room: 20 places, panoramas of 90 x 36 pixels, model votes", str(built.folder)]
    one, other = run_small(), run_small("--set", f"map={built.folder}")
    trajectories = [(done.folder / "noon_00" / "run_0" / "trajectory.tum").read_bytes() for done in (one, other)]
    assert trajectories[0] == trajectories[1]


def test_tracking_with_the_kalman_filter_stands_beside_the_paper(run_small):
    done = run_small(config="kalman")
    assert done.code == 0, done.err
    assert "Beside Table 2 of Steinbauer & Bischof (2004)" in done.out


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", sorted(path.stem for path in CONFIGS.glob("*.yaml") if not path.stem.startswith(("compare_", "simulate_", "live")))
)
def test_every_shipped_configuration_runs(name, panoloc, tmp_path):
    done = panoloc("run", CONFIGS / f"{name}.yaml", "--set", "sequences=[noon_00]", "--out", tmp_path)
    assert done.code == 0, done.err
    assert done.folder.parent == tmp_path / name
    assert (done.folder / "metrics.json").is_file()

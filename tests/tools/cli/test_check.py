from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[3] / "configs"


CHECKED = [path for path in sorted(CONFIGS.glob("*.yaml")) if not path.stem.startswith(("compare_", "live"))]


@pytest.mark.parametrize("path", CHECKED, ids=lambda path: path.stem)
def test_shipped_configurations_have_no_faults(panoloc, path):
    done = panoloc("check", path)
    assert (done.code, done.out, done.err) == (0, "no faults\n", "")


def test_three_mistakes_are_all_named(panoloc, tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("sed: 1\nruns: 0\nlocalizer: {mode: monte_karlo}\n")
    done = panoloc("check", path)
    assert (done.code, done.out) == (2, "")
    assert len(done.err.splitlines()) == 3
    for word in ("unknown key 'sed'", "runs = 0", "localizer.mode = 'monte_karlo'"):
        assert word in done.err


def test_faults_of_the_data_set_come_with_those_of_the_configuration(panoloc, small_room, drive):
    (drive / "frames.csv").unlink()
    done = panoloc("check", CONFIGS / "global.yaml", "--set", f"dataset={small_room}", "--set", "runs=0")
    assert done.code == 2
    assert len(done.err.splitlines()) == 2
    assert "frames.csv" in done.err


def test_images_are_decoded(panoloc, small_room, drive):
    image = drive / "images" / "f003.png"
    image.write_bytes(image.read_bytes()[:-200])
    done = panoloc("check", CONFIGS / "global.yaml", "--set", f"dataset={small_room}")
    assert done.code == 2
    assert "cut off" in done.err


def test_what_configuration_and_data_set_ask_of_each_other(panoloc, small_room, drive):
    words = ("check", CONFIGS / "track.yaml", "--set", f"dataset={small_room}")
    assert panoloc(*words).code == 0
    assert "'evening_*' fits none" in panoloc(*words, "--set", "sequences=['evening_*']").err
    (drive / "groundtruth.tum").unlink()
    done = panoloc(*words, "--set", "map=none.panomap")
    assert done.code == 2
    assert len(done.err.splitlines()) == 2
    assert "none.panomap: no such map file" in done.err
    assert "noon_00 has no ground truth" in done.err


def test_nothing_is_kept_of_it(panoloc, tmp_path, monkeypatch):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    assert panoloc("check", CONFIGS / "global.yaml").code == 0
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("words", [("--set", "dataset=hal"), ("--set", "dataset=room"), ("--set", "dataset=/none/at/all")])
def test_data_sets_that_are_not_there(panoloc, words):
    done = panoloc("check", CONFIGS / "global.yaml", *words)
    assert done.code == 2
    assert "neither a folder nor an embedded data set" in done.err


def test_nothing_is_written(panoloc, small_room, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    panoloc("check", CONFIGS / "global.yaml", "--set", f"dataset={small_room}")
    assert sorted(tmp_path.rglob("*")) == before


def test_the_configuration_of_a_live_robot(panoloc):
    done = panoloc("check", CONFIGS / "live.yaml", "--set", "map=nowhere.panomap")
    assert done.code == 2
    assert "no such map file" in done.err
    assert "and not both" in panoloc("check", CONFIGS / "live.yaml", "--set", "input.video=0").err

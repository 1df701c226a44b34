import re
import shutil
from pathlib import Path

import cv2
import pytest

from panoloc_mcl.tools.datasets import EMBEDDED

CONFIGS = Path(__file__).parents[3] / "configs"


CHECKED = [path for path in sorted(CONFIGS.glob("*.yaml")) if not path.stem.startswith(("compare_", "live"))]


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "named"), [(1.0, False), (15.0, False), (60.0, False), ("uneven", False), (200.0, True)])
def test_images_far_apart_without_odometry_count_or_are_named(gap, named, panoloc, small_room, drive):
    """Far apart but evenly, they count (`tests/robot/test_clocks.py`); where they would not, the check says so before a run does."""
    (drive / "odometry.tum").unlink()
    (drive / "groundtruth.tum").unlink()
    files = sorted(path.name for path in (drive / "images").iterdir())
    gaps = [15.0 if number % 2 else 100.0 for number in range(len(files))] if gap == "uneven" else [gap] * len(files)
    rows = [f"{sum(gaps[:number])},images/{file}" for number, file in enumerate(files)]
    (drive / "frames.csv").write_text("\n".join(["timestamp,file", *rows]) + "\n")
    done = panoloc("check", CONFIGS / "global.yaml", "--set", f"dataset={small_room}")
    assert done.code == (2 if named else 0), done.err
    assert ("would be left out" in done.err) == named
    if named:
        words = ("--set", f"dataset={small_room}", "--set", "localizer.motion.clock_jump_s=300")
        assert panoloc("check", CONFIGS / "global.yaml", *words).code == 0


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "word"),
    [
        pytest.param(lambda image: image[:, ::-1], "mirrored", id="mirrored"),
        pytest.param(lambda image: image[::-1], "upside down", id="upside down"),
    ],
)
def test_images_the_wrong_way_round_are_called_so(panoloc, tmp_path, change, word):
    """Rendered from a scene, then changed on purpose: all images alike, as a wrong export does."""
    folder = Path(shutil.copytree(EMBEDDED["hall"], tmp_path / "hall"))
    for kept in sorted((folder / "sequences").iterdir())[1:]:
        shutil.rmtree(kept)
    for file in [*folder.rglob("*.png"), *folder.rglob("*.jpg")]:
        cv2.imwrite(str(file), change(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)))
    done = panoloc("check", CONFIGS / "global.yaml", "--set", f"dataset={folder}")
    assert done.code == 2
    (line,) = done.err.splitlines()
    assert word in line
    assert str(folder) in line


@pytest.mark.slow
def test_a_camera_that_is_not_as_described_is_named_with_what_is_off(panoloc, tmp_path):
    folder = Path(shutil.copytree(EMBEDDED["hall"], tmp_path / "hall"))
    file = folder / "dataset.yaml"
    said = file.read_text()
    text = re.sub(r"elevation_deg: *\[-50(\.0)?, 25(\.0)?\]", "elevation_deg: [-46, 29]", said)
    if text == said:
        text = re.sub(r"- -50(\.0)?\n( *)- 25(\.0)?", r"- -46.0\n\2- 29.0", said)
    assert text != said
    file.write_text(text)
    done = panoloc("check", CONFIGS / "global.yaml", "--set", f"dataset={folder}")
    assert done.code == 0
    (line,) = [line for line in done.out.splitlines() if "camera: looks off" in line]
    assert "elevation shift -" in line
    assert "panoloc calibrate" in line

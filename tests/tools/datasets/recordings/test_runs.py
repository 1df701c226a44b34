"""`panoloc run` over recordings gives what it gives over the folders that they were written from."""

import json
import shutil
from pathlib import Path

import pytest

from panoloc_mcl.laboratory.layouts.bags import write_ros1, write_ros2
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import Dataset

FIGURES = ("position_median_m", "heading_median_deg", "frames", "ape_rmse_m")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def run(dataset: Path, out: Path, *more: str) -> Path:
    words = ["run", "configs/global.yaml", "--set", f"dataset={dataset}", "--out", str(out), *more]
    assert main(words) == 0
    return out / "global" / "latest"


@pytest.mark.slow
@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_a_data_set_with_recordings(form: str, small_room: Dataset, cache: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(cache))
    drive = small_room.sequences["noon_00"]
    first = run(small_room.path, tmp_path / "folders")
    shutil.copytree(small_room.path, tmp_path / "data", ignore=shutil.ignore_patterns("sequences"))
    (tmp_path / "data" / "sequences").mkdir()
    if form == "bag":
        write_ros1(drive, tmp_path / "data" / "sequences" / "noon_00")
    else:
        write_ros2(drive, tmp_path / "data" / "sequences" / "noon_00", ".png", "mcap")
    second = run(tmp_path / "data", tmp_path / "bags")
    for name in ("trajectory.tum", "groundtruth.tum"):
        one, other = (folder / "noon_00" / "run_0" / name for folder in (first, second))
        assert one.read_bytes() == other.read_bytes()
    metrics = [json.loads((folder / "metrics.json").read_text())["overall"] for folder in (first, second)]
    assert {name: metrics[0][name] for name in FIGURES} == {name: metrics[1][name] for name in FIGURES}
    # The bag alone, with a map file: the camera is taken to be the map's.
    bag = next((tmp_path / "data" / "sequences").iterdir())
    assert main(["build-map", str(small_room.path), "-o", str(tmp_path / "room.panomap")]) == 0
    third = run(bag, tmp_path / "alone", "--set", f"map={tmp_path / 'room.panomap'}")
    assert (third / "noon_00" / "run_0" / "trajectory.tum").read_bytes() == (
        first / "noon_00" / "run_0" / "trajectory.tum"
    ).read_bytes()


def test_a_recording_without_references_says_where_a_map_may_come_from(small_room: Dataset, tmp_path: Path, capsys) -> None:
    from panoloc_mcl.robot.camera import to_mapping
    from panoloc_mcl.robot.settings.validation import dump_yaml

    drive = small_room.sequences["noon_00"]
    bag = write_ros1(drive, tmp_path / "noon_00")
    (tmp_path / "camera.yaml").write_text(dump_yaml(to_mapping(drive.camera)))
    for command in ("run", "check"):
        assert main([command, "configs/global.yaml", "--set", f"dataset={bag}"]) == 2
        assert "holds no references; set map to a map file, or references" in capsys.readouterr().err

"""build-map, export and inspect, from references and from a drive, in the small room."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl import PanoramaMap
from panoloc_mcl.tools.datasets import read_dataset, read_tum

FAST = ["--set", "observation.votes.calibration_references=0", "--set", "observation.votes.virtual_places.spacing_m=0.5"]


@pytest.mark.slow
def test_a_map_from_a_drive_is_told_drawn_and_written_out(small_room, panoloc, tmp_path: Path):
    mapped = tmp_path / "drive.panomap"
    folder = getattr(small_room, "path", small_room)
    assert panoloc("build-map", folder, "-o", mapped, "--drives", "*", *FAST).code == 0
    assert [file.name for file in tmp_path.iterdir() if file.suffix == ".parts"] == []
    built = PanoramaMap.load(mapped)
    assert len(built.keyframes) == len(built.references)
    assert len(built.keyframes.edges) > len(built.keyframes)
    table = list(csv.DictReader((mapped.with_name("drive_mending") / "poses_mended.csv").open()))
    assert len(table) == len(built.references)
    told = panoloc("inspect", mapped, "--json")
    graph = json.loads(told.out)["graph"]
    assert graph["keyframes"] == len(built.references)
    assert graph["edges"]["images"] > 0
    assert "relative poses" in panoloc("inspect", mapped, "-o", tmp_path / "map.png").out
    done = panoloc("export", mapped, "-o", tmp_path / "out", "--tum", tmp_path / "keyframes.tum")
    assert done.code == 0
    again = read_dataset(tmp_path / "out").references
    np.testing.assert_allclose(again.poses[:, :2], built.references.positions)
    assert again.camera.height_m == built.references.camera_height_m
    trajectory = read_tum(tmp_path / "keyframes.tum")
    np.testing.assert_allclose(trajectory.times, built.keyframes.times)
    np.testing.assert_allclose(trajectory.poses[:, :2], built.keyframes.poses[:, :2], atol=1e-8)
    assert panoloc("export", mapped, "-o", tmp_path / "out").code == 2


@pytest.mark.slow
def test_a_map_is_replaced_by_its_update_or_stays_to_the_last_byte(small_room, panoloc, tmp_path: Path):
    mapped = tmp_path / "room.panomap"
    assert panoloc("build-map", small_room, "-o", mapped, *FAST).code == 0
    before = mapped.read_bytes()
    done = panoloc("update-map", mapped, small_room, "--drives", "*", "--json", *FAST)
    assert done.code == 0
    answer = json.loads(done.out)
    (line,) = answer["done"]
    assert line.startswith(f"drive {next(iter(read_dataset(small_room).sequences))}: ")
    assert (mapped.read_bytes() == before) == (not answer["changed"])
    assert [file.name for file in tmp_path.iterdir() if file.suffix == ".parts"] == []
    # A map that is not there stays not there.
    assert panoloc("update-map", tmp_path / "none", small_room, "--drives", "*").code == 2
    assert not (tmp_path / "none").exists()


def test_a_drive_without_odometry_is_one_line(panoloc, room: Path, tmp_path: Path):
    for file in room.glob("sequences/*/odometry.tum"):
        file.unlink()
    done = panoloc("build-map", room, "-o", tmp_path / "map", "--drives", "*")
    assert done.code == 2
    (line,) = done.err.splitlines()
    assert "has no odometry" in line
    assert not (tmp_path / "map").exists()


def test_a_drive_that_is_not_there_is_one_line(panoloc, room: Path, tmp_path: Path):
    done = panoloc("build-map", room, "-o", tmp_path / "map", "--drives", "nowhere")
    assert done.code == 2
    assert "'nowhere' fits none" in done.err

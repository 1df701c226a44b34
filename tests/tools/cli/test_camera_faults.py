"""A camera that is described wrongly ends a command with one line: file, key, value, remedy."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from panoloc_mcl.tools.cli.main import main

SIZE = (64, 32)
_LENS = {"kind": "kannala_brandt", "fx": 10.0, "fy": 10.0, "cx": 15.5, "cy": 15.5}
_PANORAMA = {"kind": "panorama", "elevation_deg": [-50, 25], "height_m": 0.6}
_UP = {"kind": "omni", "looks": "up", "height_m": 0.6}
_PAIR = {"kind": "fisheye_pair", "height_m": 0.6, "front": {"lens": _LENS}, "back": {"lens": _LENS, "offset_px": [32, 0]}}


def data_set(folder: Path, camera: dict, size=SIZE, name="{}.png") -> Path:
    """Two references and a drive of two images, all of them noise."""
    rng = np.random.default_rng(0)
    for part, table in (("references", "file,x,y,theta"), ("sequences/a", "file,timestamp")):
        rows = [table]
        for index in range(2):
            file = folder / part / name.format(index)
            file.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(file), rng.integers(0, 255, size[::-1], dtype=np.uint8))
            rows.append(f"{name.format(index)},{index}" + (",0,0" if part == "references" else ""))
        table_file = "poses.csv" if part == "references" else "frames.csv"
        (folder / part / table_file).write_text("\n".join(rows) + "\n")
    said = {"format": "panoloc-dataset/1", "name": "a", "camera": camera}
    (folder / "dataset.yaml").write_text(yaml.safe_dump(said))
    return folder


def painted(folder: Path, size: tuple[int, int], level: int) -> None:
    cv2.imwrite(str(folder / "mask.png"), np.full(size[::-1], level, dtype=np.uint8))


def lines_of(capsys, folder: Path) -> list[str]:
    """What `panoloc calibrate` ends with."""
    assert main(["calibrate", str(folder)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    return said.err.strip().splitlines()


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ({**_PANORAMA, "mask": "small.png"}, ["mask = 8 x 4", "64 x 32"]),
        ({**_PANORAMA, "mask": "black.png"}, ["camera.mask", "black all over"]),
        ({**_PANORAMA, "mask": "none.png"}, ["camera.mask", "none.png", "no such file"]),
        ({**_PANORAMA, "mount": {"x_m": 15.0}}, ["camera.mount", "x_m = 15", "far: true"]),
        ({**_UP, "file": "unknown.yaml"}, ["camera.file", "unknown.yaml", "known kind"]),
        (
            {**_UP, "lens": {**_LENS, "fx": 30.0, "fy": 30.0}, "panorama": {"size": [90, 20], "elevation_deg": [-80, -40]}},
            ["[-80, -40]", "field"],
        ),
        ({**_UP, "file": "cameras.txt"}, ["calibrated for 1280 x 960", "64 x 32"]),
        ({**_PAIR, "files": ["front", "front"]}, ["camera", "files", "do not tell"]),
        ({**_PAIR, "files": ["front", "back"], "back": {"lens": _LENS}}, ["camera", "back.offset_px"]),
    ],
)
def test_one_line_says_what_is_wrong_with_a_camera(tmp_path, capsys, camera, words):
    folder = data_set(tmp_path / "data", camera)
    cv2.imwrite(str(folder / "small.png"), np.full((4, 8), 255, dtype=np.uint8))
    cv2.imwrite(str(folder / "black.png"), np.zeros(SIZE[::-1], dtype=np.uint8))
    (folder / "unknown.yaml").write_text("hello: world\n")
    (folder / "cameras.txt").write_text("1 OPENCV_FISHEYE 1280 960 300 300 640 480 0 0 0 0\n")
    lines = lines_of(capsys, folder)
    # Folders that share a camera are each named.
    assert len({line.partition(": ")[2] for line in lines}) == 1
    for word in words:
        assert word in lines[0]
    assert str(folder) in lines[0]
    assert re.search(r"[;:] \w[^;:]*$", lines[0]), f"no remedy: {lines[0]}"


def test_a_pair_with_one_file_missing_is_named(tmp_path, capsys):
    folder = data_set(tmp_path / "data", {**_PAIR, "files": ["front", "back"]}, (32, 32), "front/{}.png")
    for part in ("references", "sequences/a"):
        (folder / part / "back").mkdir()
        for index in range(2):
            cv2.imwrite(str(folder / part / "back" / f"{index}.png"), np.zeros((32, 32), dtype=np.uint8))
    (folder / "sequences/a/back/1.png").unlink()
    (line,) = lines_of(capsys, folder)
    for word in (str(folder / "sequences/a"), "front/1.png", "back/1.png is missing", "; add it"):
        assert word in line

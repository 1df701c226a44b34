import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.datasets.recordings import sequence_of


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Dataset]:
    from oracles.furnished_room import build_room

    from panoloc_mcl.robot.camera import PanoramaGeometry

    folder = tmp_path_factory.mktemp("live")
    grid = tuple((float(x), float(y)) for y in range(3) for x in range(4))
    data = build_room(folder / "data", frames=12, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon",))
    dataset = read_dataset(data)
    PanoramaMap.build(dataset).save(folder / "room.panomap")
    (folder / "live.yaml").write_text(
        f"map: {folder / 'room.panomap'}\ninput: {{recording: {data}, rate: 0}}\n"
        f"state: {{file: {folder / 'state.npz'}, every_s: 0.1}}\n"
    )
    return folder, dataset


def lines(text: str) -> list[dict]:
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


@pytest.mark.slow
def test_a_robot_on_one_of_two_floors(setup, tmp_path: Path, capsys) -> None:
    folder, dataset = setup
    shutil.copy(folder / "room.panomap", tmp_path / "ground.panomap")
    upside_down = tmp_path / "other"
    shutil.copytree(dataset.path, upside_down)
    for file in (upside_down / "references").glob("*.png"):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert image is not None
        cv2.imwrite(str(file), np.ascontiguousarray(image[::-1]))
    PanoramaMap.build(read_dataset(upside_down)).save(tmp_path / "first.panomap")
    text = (folder / "live.yaml").read_text().splitlines()
    maps = f"maps: [{tmp_path / 'ground.panomap'}, {tmp_path / 'first.panomap'}]"
    lift = "transitions: [{between: [ground, first], at: [[0, 0], [0, 0]]}]"
    config = tmp_path / "live.yaml"
    config.write_text("\n".join([maps, lift, *text[1:]]).replace(str(folder / "state.npz"), str(tmp_path / "state.npz")))
    assert main(["live", str(config)]) == 0
    answers = lines(capsys.readouterr().out)
    assert [answer["map"] for answer in answers[-3:]] == ["ground"] * 3
    assert answers[-1]["status"] == "converged"
    # One of two sets of files, by turns: which, depends on how often it was saved.
    saved = sorted(path.name for path in tmp_path.glob("state*.npz"))
    assert saved in [[f"state.0.{which}.npz", f"state.1.{which}.npz", "state.npz"] for which in (0, 1)]
    assert main(["check", str(config)]) == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"map": "null"}, "needs map or maps, and not both"),
        ({"maps": "[a.panomap]"}, "needs map or maps, and not both"),
        ({"map": "null", "maps": "[a.panomap, b/a.panomap]"}, "two files have one name"),
        (
            {"map": "null", "maps": "[a.panomap, b.panomap]", "transitions": "[{between: [a, c], at: [[0, 0], [1, 1]]}]"},
            "between = c: is none of maps; known: a, b",
        ),
        ({"map": "null", "maps": "[a.panomap]", "transitions": "[{between: [a], at: [[0, 0], [1, 1]]}]"}, "between"),
    ],
)
def test_maps_that_cannot_be_are_one_line(setup, change: dict[str, str], said: str, capsys) -> None:
    words = [word for key, value in change.items() for word in ("--set", f"{key}={value}")]
    assert main(["live", str(setup[0] / "live.yaml"), *words]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert said in told[0]


def test_poses_come_out_and_what_was_seen_is_recorded(setup, tmp_path: Path, capsys) -> None:
    folder, dataset = setup
    drive = dataset.sequences["noon_00"]
    record = tmp_path / "seen.mcap"
    words = ["live", str(folder / "live.yaml"), "--record", str(record), "--set", f"state.file={tmp_path / 'state.npz'}"]
    assert main(words) == 0
    captured = capsys.readouterr()
    answers = lines(captured.out)
    assert len(answers) == len(drive)
    errors = [np.hypot(*(np.array(line["pose"][:2]) - drive.groundtruth.at(line["timestamp"])[:2])) for line in answers]
    assert np.median(errors) < 0.5
    assert "12 images, 0 dropped" in captured.err
    assert len(sequence_of(record, camera=drive.camera)) == len(drive)
    assert (tmp_path / "state.npz").exists()
    # The file that is there is not overwritten.
    assert main(words) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("input.video=7", "and not both"),
        ("map=nowhere.panomap", "no such map file"),
        ("input={video: nowhere.mp4}", "cannot be opened"),
        ("input.sequence=noon_07", "did you mean 'noon_00'"),
        ("output.foxglove.port=99999", "less than or equal to 65535"),
    ],
)
def test_what_cannot_be_used_is_one_line(setup, override: str, said: str, capsys) -> None:
    assert main(["live", str(setup[0] / "live.yaml"), "--set", override]) == 2
    err = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(("note", "[", "OpenCV"))]
    assert said in err[-1]


def test_a_port_in_use_is_one_line(setup, capsys) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["live", str(setup[0] / "live.yaml"), "--foxglove", str(port), "--set", "state.file=null"]) == 2
    err = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(("note", "["))]
    assert len(err) == 1
    assert f"output.foxglove.port = {port}: cannot be served on" in err[0]


def halves(folder: Path, dataset: Dataset) -> tuple[Path, Path, float]:
    """The drive in two, as if the program had been stopped between them while odometry went on; and when the second begins."""
    drive = dataset.sequences["noon_00"]
    begins = float(drive.times[6]) - 0.2
    for name in ("first", "second"):
        shutil.copytree(dataset.path, folder / name)
        inside = folder / name / "sequences" / "noon_00"
        for file in (inside / "frames.csv", inside / "odometry.tum", inside / "groundtruth.tum"):
            kept = []
            for line in file.read_text().splitlines():
                number = line.replace(",", " ").split()[0]
                is_row = number[0].isdigit()
                if not is_row or file.name == "groundtruth.tum" or (float(number) < begins) == (name == "first"):
                    kept.append(line)
            file.write_text("\n".join(kept) + "\n")
    return folder / "first", folder / "second", begins


@pytest.mark.slow  # starts the program three times
def test_killed_and_started_again_it_goes_on_where_it_was(setup, tmp_path: Path) -> None:
    folder, dataset = setup
    drive = dataset.sequences["noon_00"]
    first_half, second_half, _ = halves(tmp_path, dataset)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3]), "PYTHONUNBUFFERED": "1"}

    def start(half: Path, state: str) -> subprocess.Popen[str]:
        settings = {"input.recording": half, "state.file": tmp_path / state, "output.movements": "true"}
        command = [sys.executable, "-m", "panoloc_mcl", "live", str(folder / "live.yaml"), "--rate", "1"]
        command += [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)

    def error(line: dict) -> float:
        return float(np.hypot(*(np.array(line["pose"][:2]) - drive.groundtruth.at(line["timestamp"])[:2])))

    def until_answer(process: subprocess.Popen[str]) -> list[dict]:
        found = [json.loads(process.stdout.readline())]
        while found[-1]["kind"] != "answer":
            found.append(json.loads(process.stdout.readline()))
        return found

    first = start(first_half, "state.npz")
    for _ in range(5):
        last = until_answer(first)[-1]
    assert last["status"] == "converged"
    time.sleep(0.3)
    assert first.poll() is None
    first.kill()
    assert first.wait() == -signal.SIGKILL
    second, new = start(second_half, "state.npz"), start(second_half, "none.npz")
    # Before any image the pose is known from the saved state, and at the first image it is sure.
    lines_again = until_answer(second)
    assert lines_again[0]["kind"] == "pose"
    for line in lines_again:
        assert line["status"] == "converged"
        assert error(line) < 0.5
    # Without it nothing is known before the first image.
    assert [line["kind"] for line in until_answer(new)] == ["answer"]
    for process in (second, new):
        process.send_signal(signal.SIGTERM)
    _, err = second.communicate(timeout=60)
    assert second.returncode == 0
    assert "goes on from" in err
    assert "images" in err.splitlines()[-1]
    new.communicate(timeout=60)

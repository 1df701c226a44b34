import json
import re
import shutil

import pytest

from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.tools.report import read_results

HEADER = "timestamp,status,best_place,kidnapped,ms_total"


def fault_of(path):
    with pytest.raises(ResultsError) as caught:
        read_results(path)
    assert len(caught.value.faults) == 1
    return caught.value.faults[0]


def test_a_run_that_did_not_finish_is_said_to_be_one(unfinished):
    writer, _ = unfinished
    assert re.search(r"20240506_070809: the run did not finish \(metrics.json missing\); run again", fault_of(writer.path))
    assert not (writer.path.parent / "latest").exists()


def test_a_folder_without_sequences(finished):
    path, _ = finished
    shutil.rmtree(path / "noon_00")
    shutil.rmtree(path / "evening_00")
    assert "the folders of the sequences missing" in fault_of(path)


def test_foreign_and_missing_folders(tmp_path, finished):
    path, _ = finished
    (tmp_path / "photos").mkdir()
    assert "photos: is not a results folder" in fault_of(tmp_path / "photos")
    assert "no such folder" in fault_of(tmp_path / "nowhere")
    assert "is a file; name the results folder" in fault_of(path / "run.json")
    assert f"holds several runs; name one of them, or {path.parent.resolve() / 'latest'}" in fault_of(path.parent)


@pytest.mark.parametrize(("file", "key"), [("metrics.json", "schema"), ("run.json", "format")])
def test_newer_and_unknown_versions(finished, file, key):
    path, _ = finished
    data = json.loads((path / file).read_text())
    name = data[key].partition("/")[0]
    (path / file).write_text(json.dumps({**data, key: f"{name}/2"}))
    assert f"{key} = '{name}/2' is newer than '{name}/1'; upgrade panoloc-mcl" in fault_of(path)
    (path / file).write_text(json.dumps({**data, key: "other"}))
    assert f"{key} = 'other', must be '{name}/1'" in fault_of(path)


@pytest.mark.parametrize(
    ("file", "text", "fault"),
    [
        ("metrics.json", "{", "metrics.json:1: not valid JSON"),
        ("run.json", "[]", "run.json: holds a list"),
        ("places.csv", "index,x\n", "places.csv: the first line must be 'index,file,x,y'"),
        ("places.csv", "index,file,x,y\n0,a.png,1,2\n2,b.png,1,2\n", "places.csv:3: '2,b.png,1,2', must be 1"),
        ("places.csv", "index,file,x,y\n0,a.png,1\n", "places.csv:2"),
        ("noon_00/run_0/steps.csv", "", "column timestamp, status, best_place, kidnapped, ms_total is missing"),
        (
            "noon_00/run_0/steps.csv",
            HEADER + "\n1.5,conv",
            "steps.csv:2: the row is cut short",
        ),
        (
            "noon_00/run_0/steps.csv",
            HEADER + "\n1.5,converged,0,maybe,1.0\n",
            "steps.csv:2: kidnapped = 'maybe' cannot be read",
        ),
        (
            "noon_00/run_0/steps.csv",
            HEADER + "\n1.5,converged,0,0,1.0\n",
            "trajectory.tum: 25 poses for 1 rows of steps.csv",
        ),
        ("noon_00/run_0/trajectory.tum", "1 2 3\n", "trajectory.tum:1"),
        ("noon_00/run_0/groundtruth.tum", "1.0 0 0 0 0 0 0 1\n", "groundtruth.tum: pose 0 is of 1.000000000"),
    ],
)
def test_damaged_files_are_named(finished, file, text, fault):
    path, _ = finished
    (path / file).write_text(text)
    assert fault in fault_of(path)


def test_stamps_that_do_not_belong_together(finished):
    path, _ = finished
    file = path / "noon_00/run_0/trajectory.tum"
    lines = file.read_text().splitlines()
    first, rest = lines[1].split(" ", 1)
    lines[1] = f"{float(first) - 0.5:.9f} {rest}"
    file.write_text("\n".join(lines))
    assert "trajectory.tum: pose 0 is of" in fault_of(path)


def test_a_status_that_is_none_names_the_folder(finished):
    path, _ = finished
    file = path / "noon_00/run_0/steps.csv"
    file.write_text(file.read_text().replace("ambiguous", "baffled"))
    assert "run_0: sequence 'noon_00', run 0: status, frame 1: 'baffled'" in fault_of(path)


def test_a_missing_steps_file(finished):
    path, _ = finished
    (path / "noon_00/run_1/steps.csv").unlink()
    assert "steps.csv: no such file" in fault_of(path)

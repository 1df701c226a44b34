"""Every wrong convention is named, and none in good data.

Data: the embedded hall, and the recorded hall and office where they are at hand. They share nothing with the views that conventions
are told by: they are rendered from scenes.
"""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles import conventions as wrong

from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.conventions import convention_findings, drive_findings, reference_findings, stamp_findings
from panoloc_mcl.tools.conventions.references import height_findings, reference_fit
from panoloc_mcl.tools.datasets import EMBEDDED, read_dataset, read_image, write_image

RECORDED = Path(__file__).parents[3].parent / "shared" / "data"
NAMES = ["embedded", "hall", "office"]


@pytest.fixture(scope="module", params=NAMES)
def dataset(request):
    path = EMBEDDED["hall"] if request.param == "embedded" else RECORDED / request.param
    if not path.is_dir():
        pytest.skip(f"needs {path}")
    if request.param != "embedded" and request.config.getoption("-m") != "slow":
        pytest.skip("with -m slow only")
    return read_dataset(path)


@pytest.fixture(scope="module")
def turned(dataset, tmp_path_factory):
    """Its references at headings of their own."""
    return wrong.turned(dataset.references, tmp_path_factory.mktemp("turned"), seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(wrong.REFERENCES))
def test_references_in_another_convention_are_named(kind, turned, tmp_path):
    change, names = wrong.REFERENCES[kind]
    changed = change(turned, tmp_path)
    fit = reference_fit(changed)
    assert height_findings(changed) or (fit is not None and fit.reading.kind in names)
    (line,) = reference_findings(changed)
    assert line.startswith(str(turned.path))
    assert ";" in line


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(wrong.DRIVES))
def test_drives_in_another_convention_are_named(kind, dataset, tmp_path):
    change, word = wrong.DRIVES[kind]
    drive = next(iter(dataset.sequences.values()))
    if kind == "12 s late" and np.ptp(drive.times) < 30.0:
        pytest.skip("too short for clocks so far apart")
    changed = change(drive, tmp_path)
    found = stamp_findings(changed) or drive_findings(changed)
    assert len(found) == 1
    assert word in found[0]


@pytest.mark.parametrize("name", ["noon_00", "people_00"])
def test_headings_that_nobody_measured_are_not_called_degrees(name):
    # A few degrees are nearly no turn, and no turn fits better than wrong ones.
    rng = np.random.default_rng(0)

    def astray(poses):
        return poses + np.column_stack([np.zeros((len(poses), 2)), np.cumsum(rng.normal(0.0, 0.3, len(poses)))])

    (line,) = drive_findings(wrong.with_odometry(read_dataset(EMBEDDED["hall"]).sequences[name], astray))
    assert "though the images hardly turn" in line


@pytest.mark.slow
def test_degrees_in_rotations_are_named(dataset):
    # A file of quaternions keeps of 400 degrees what is left of so many radians.
    named = [
        line
        for drive in list(dataset.sequences.values())[:3]
        for line in drive_findings(
            wrong.with_odometry(drive, lambda p: np.column_stack([p[:, :2], wrap_angle(wrong.degrees(p)[:, 2])]))
        )
    ]
    assert named
    assert all("degrees" in line for line in named)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.7, 1.5, 3.0, -2.0])
def test_an_offset_is_estimated(late, dataset):
    drive = next(iter(dataset.sequences.values()))
    (line,) = drive_findings(wrong.with_odometry(drive, wrong.same, late))
    said = float(line.partition("camera.time_offset_s: ")[2].partition(",")[0])
    assert said == pytest.approx(late, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(7))
def test_no_alarm_on_good_data(part, dataset, turned):
    """Seven parts of each of three data sets: other references, at their own headings or none, other drives."""
    rng = np.random.default_rng(part)
    whole = turned if part % 2 else dataset.references
    chosen = np.sort(rng.permutation(len(whole))[: max(12, len(whole) * 2 // 3)])
    some = replace(whole, files=tuple(whole.files[i] for i in chosen), poses=whole.poses[chosen])
    drives = list(dataset.sequences.values())
    drive = drives[part % len(drives)]
    assert reference_findings(some) == []
    assert stamp_findings(drive) + drive_findings(drive) == []


def test_a_good_data_set_is_good():
    hall = read_dataset(EMBEDDED["hall"])
    assert convention_findings(hall, most_drives=1) == []


@pytest.mark.slow
def test_drives_tell_whether_poses_or_images_are_mirrored(tmp_path):
    hall = read_dataset(EMBEDDED["hall"])
    name, drive = next(iter(hall.sequences.items()))
    poses = replace(hall, references=wrong.with_poses(hall.references, lambda p: p * [1, -1, -1]), sequences={name: drive})
    (line,) = convention_findings(poses)
    assert "left-handed" in line or "y fits with the other sign" in line

    def mirror(image):
        return image[:, ::-1]

    images = replace(
        hall,
        references=wrong.changed(hall.references, tmp_path / "references", mirror),
        sequences={name: wrong.changed(drive, tmp_path / "drive", mirror)},
    )
    (line,) = convention_findings(images)
    assert "images fit mirrored" in line
    assert "camera.columns" in line


@pytest.fixture
def mirrored_hall(tmp_path):
    """The embedded hall with one drive, its references mirrored, on disk."""
    path = Path(shutil.copytree(EMBEDDED["hall"], tmp_path / "hall"))
    for file in (path / "references").glob("*.[pj][np]g"):
        write_image(file, cast("NDArray[np.uint8]", np.ascontiguousarray(read_image(file)[:, ::-1])))
    for folder in sorted((path / "sequences").iterdir())[1:]:
        shutil.rmtree(folder)
    return path


@pytest.mark.slow
def test_the_commands_say_so(mirrored_hall, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "run.yaml").write_text(f"dataset: {mirrored_hall}\nout: {tmp_path / 'out'}\n")
    assert main(["check", str(tmp_path / "run.yaml")]) == 2
    assert "mirrored" in capsys.readouterr().err
    assert main(["build-map", str(mirrored_hall), "-o", str(tmp_path / "a.panomap")]) == 2
    assert "--as-written" in capsys.readouterr().err
    assert not (tmp_path / "a.panomap").exists()
    assert main(["run", str(tmp_path / "run.yaml")]) == 0
    assert "mirrored" in capsys.readouterr().err

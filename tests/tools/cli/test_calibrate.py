"""``panoloc calibrate`` from a folder to a camera that is read again."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from oracles.rooms import BareRoom

from panoloc_mcl.robot.camera import Mount, PanoramaCamera, PanoramaGeometry
from panoloc_mcl.robot.camera.files import read_camera
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.datasets.writer import DatasetWriter

GEOMETRY = PanoramaGeometry(120, 48, -50.0, 25.0)
TRUE = Mount(x_m=0.12, y_m=0.0, yaw_deg=-8.0)


def recorded(folder: Path) -> Path:
    """A room, twelve references at random headings, and a drive that turns; nobody says where the camera sits."""
    rng = np.random.default_rng(2)
    world = BareRoom(finest_m=0.3)

    def images(poses):
        for pose in poses:
            yield world.panorama(GEOMETRY, TRUE.camera_poses(pose) + np.array([0.0, 0.0, TRUE.yaw])).pixels.astype(np.uint8)

    writer = DatasetWriter(folder, "room", PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6))
    references = np.array([(x, y, rng.uniform(-np.pi, np.pi)) for x in (0.0, 0.7, 1.4, 2.1) for y in (0.0, 0.6, 1.2)])
    writer.add_references(images(references), references)
    times = (np.arange(14) * 0.8).astype(np.float64)
    heading = 0.9 * np.sin(0.9 * times)
    drive = np.stack([0.3 + 0.1 * times, 0.5 + 0.1 * np.sin(times), heading], axis=-1)
    odometry = Trajectory(times, drive)
    writer.add_sequence("noon_00", times, images(drive), odometry, odometry)
    return writer.finish()


@pytest.mark.slow
def test_a_camera_is_found_written_and_read_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recorded(tmp_path / "room")
    out = tmp_path / "found" / "camera.yaml"
    assert main(["calibrate", str(folder), "-o", str(out), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert answer["files"][-1] == str(out)
    assert all(Path(file).is_file() for file in answer["files"])
    camera = read_camera(out)
    assert camera.mounting.yaw_deg == pytest.approx(-8.0, abs=0.3)
    assert camera.mounting.x_m == pytest.approx(0.12, abs=0.01)
    assert camera.mounting.y_m == pytest.approx(0.0, abs=0.01)
    assert any("mask" in line for line in answer["verdicts"])
    # Named in dataset.yaml it is the data set's camera.
    text = (folder / "dataset.yaml").read_text()
    start = text.index("camera:")
    (folder / "dataset.yaml").write_text(f"{text[:start]}camera: {{file: {out}}}\n")
    from panoloc_mcl.tools.datasets import read_dataset

    assert read_dataset(folder).camera == camera


def unrelated(folder: Path, strut: slice | None = None) -> Path:
    """Fourteen smooth textures that have nothing to do with each other, but for a striped strut over all rows."""
    rng = np.random.default_rng(4)

    def images():
        for _ in range(14):
            image = cv2.GaussianBlur(rng.integers(0, 255, (48, 120)).astype(np.float32), (0, 0), 2.0)
            image = np.clip(128.0 + 5.0 * (image - 128.0), 0.0, 255.0).astype(np.uint8)
            if strut is not None:
                image[:, strut] = 40 + 150 * (np.arange(48)[:, None] // 4 % 2)
            yield image

    writer = DatasetWriter(folder, "textures", PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6))
    writer.add_references(images(), np.column_stack([np.arange(14.0), np.zeros((14, 2))]))
    return writer.finish()


def test_the_mask_alone_leaves_the_rest_as_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = unrelated(tmp_path / "data", slice(20, 30))
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(folder), "-o", str(out), "--only-mask"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-1] == str(out)
    assert not any("standard deviation" in line for line in said)
    camera = read_camera(out)
    assert isinstance(camera, PanoramaCamera)
    assert (camera.mount, camera.height_m, camera.elevation_deg) == (None, 0.6, (-50.0, 25.0))
    assert camera.mask is not None
    assert (~camera.mask.world[:, 20:30]).mean() > 0.95
    assert camera.mask.world.mean() > 0.85


def test_a_calibration_of_unknown_kind_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = unrelated(tmp_path / "data")
    (tmp_path / "c.yaml").write_text("hello: world\n")
    assert main(["calibrate", str(folder), "--from", str(tmp_path / "c.yaml")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "c.yaml" in line
    assert "known kind" in line


def test_a_calibration_for_another_size_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = unrelated(tmp_path / "data")
    (tmp_path / "cameras.txt").write_text("1 OPENCV_FISHEYE 1280 960 300 300 640 480 0 0 0 0\n")
    assert main(["calibrate", str(folder), "--from", str(tmp_path / "cameras.txt")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "calibrated for 1280 x 960" in line
    assert "120 x 48" in line

"""A run in the layout of the Hilti-Trimble-Oxford data set, with numbers of its published calibration."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoloc_mcl.laboratory.layouts.bags import Messages, save_ros2
from panoloc_mcl.robot.camera import Unwrapper
from panoloc_mcl.robot.camera.unwrap import geometry_of
from panoloc_mcl.robot.errors import CameraError, DatasetError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.datasets.recordings import is_recording, read_recording, recordings_in, sequence_of

CALIBRATION = """%YAML:1.0

cam0:
  T_cam_imu:
    - [0.0172, -0.0008, -0.99985, 0.0207]
    - [0.99983, -0.0071, 0.0172, 0.0155]
    - [-0.0071, -0.99997, 0.0007, -0.0158]
    - [0.0, 0.0, 0.0, 1.0]
  camera_model: eucm
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [0.69, 0.8912, 116.3, 116.3, 182.5, 180.0]
  resolution: [368, 360]
cam1:
  T_cam_imu:
    - [0.0011, 0.0083, 0.99996, -0.0197]
    - [0.99997, -0.0079, -0.0011, 0.0149]
    - [0.0079, 0.99993, -0.0083, -0.0241]
    - [0.0, 0.0, 0.0, 1.0]
  camera_model: eucm
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [0.689, 0.8956, 116.4, 116.4, 183.4, 179.7]
  resolution: [368, 360]
"""
SIZE = (368, 360)


def fisheye(sky: int, floor: int) -> np.ndarray:
    """What a level fisheye sees whose sensor is upside down: the sky in the lower half."""
    image = np.full((SIZE[1], SIZE[0], 3), sky, np.uint8)
    image[: SIZE[1] // 2] = floor
    return image


@pytest.fixture
def run(tmp_path: Path) -> Path:
    ros, found = Messages(ros1=False), []
    start = 10_000 * 10**9
    for number in range(5):
        stamp = start + number * 33_333_333
        front, back = fisheye(200, 50), fisheye(240, 10)
        for offset, topic, image in ((0, "/cam0/image_raw/compressed", front), (1000, "/cam1/image_raw/compressed", back)):
            # The third of the back camera is missing.
            if number != 2 or "cam0" in topic:
                message = ros.compressed(stamp + offset, image, ".png")
                found.append((stamp + offset, topic, "sensor_msgs/msg/CompressedImage", message))
    folder = tmp_path / "data" / "floor_1" / "2025-05-05" / "run_1"
    folder.mkdir(parents=True)
    save_ros2(folder / "rosbag", found, ros)
    (tmp_path / "camera_calibration").mkdir()
    (tmp_path / "camera_calibration" / "eucm.yaml").write_text(CALIBRATION)
    truth = tmp_path / "groundtruth" / "per_floor" / "floor_1"
    truth.mkdir(parents=True)
    rows = ["# timestamp tx ty tz qx qy qz qw"]
    for number in range(6):
        # The camera looks to 100 degrees, its image is upside down, and it is pitched up by 20 degrees.
        body = Rotation.from_euler("ZYX", [100.0, -20.0, 180.0], degrees=True)
        optical = body * Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
        x, y, z, w = optical.as_quat()
        rows.append(f"{10_000 + number * 0.05:.6f} {number * 0.1} 2.0 1.6 {x} {y} {z} {w}")
    (truth / "floor_1_2025-05-05_run_1.txt").write_text("\n".join(rows))
    return folder


def test_a_run_is_read_with_calibration_and_truth(run: Path) -> None:
    assert is_recording(run)
    assert recordings_in(run.parent) == [run]
    drive = sequence_of(run)
    assert drive.name == "floor_1_2025-05-05_run_1"
    assert len(drive) == 4
    assert "1 images have none of the same time on the other topic" in " ".join(drive.notes)
    assert drive.odometry is None
    assert np.degrees(drive.groundtruth.poses[:, 2]) == pytest.approx(100.0)
    assert drive.groundtruth.poses[-1, :2] == pytest.approx([0.5, 2.0])
    camera = drive.camera
    assert camera.kind == "fisheye_pair"
    assert camera.front.roll_deg == 180.0
    assert abs(camera.back.yaw_deg) == pytest.approx(180.0, abs=1.5)
    assert abs(camera.back.roll_deg) == pytest.approx(180.0, abs=1.5)
    assert camera.back.pitch_deg == pytest.approx(0.0, abs=1.5)
    assert drive.image_size == (2 * SIZE[0], SIZE[1])


def test_both_images_become_one_panorama_the_right_way_up(run: Path) -> None:
    drive = sequence_of(run)
    image = read_image(drive.files[3])
    assert np.array_equal(image, np.hstack([fisheye(200, 50), fisheye(240, 10)]))
    # A look back reads the same.
    assert np.array_equal(read_image(drive.files[0]), image)
    geometry = geometry_of(drive.camera, drive.image_size)
    panorama = Unwrapper(drive.camera, drive.image_size, geometry)(image).pixels
    columns, rows = panorama.shape[1], panorama.shape[0]
    bottom, top = geometry.elevation_bottom_deg, geometry.elevation_top_deg
    above = int((top - 30.0) / (top - bottom) * rows)
    below = int((top + 30.0) / (top - bottom) * rows)
    for column, sky, floor in ((0, 200, 50), (columns // 2, 240, 10)):
        assert panorama[above, column] == pytest.approx(sky, abs=3)
        assert panorama[below, column] == pytest.approx(floor, abs=3)


def test_odometry_may_stand_beside_the_bag(run: Path) -> None:
    (run / "odometry.tum").write_text("10000.0 0 0 0 0 0 0 1\n10001.0 1 0 0 0 0 0 1\n")
    assert sequence_of(run).odometry.poses[-1, 0] == 1.0


def test_what_is_wrong_is_said_in_one_line(run: Path) -> None:
    root = run.parents[3]
    truth = next(root.rglob("floor_1_2025*.txt"))
    truth.write_text("1 2 3\n")
    with pytest.raises(DatasetError, match="is no trajectory in TUM's format"):
        sequence_of(run)
    truth.unlink()
    file = root / "camera_calibration" / "eucm.yaml"
    file.write_text(CALIBRATION.replace("T_cam_imu", "T_imu_cam"))
    with pytest.raises(CameraError, match="cam0: key 'T_cam_imu' is missing"):
        read_recording(run)
    file.unlink()
    with pytest.raises(DatasetError, match="nothing says which camera this is"):
        sequence_of(run)


def test_pixels_of_two_sizes_cannot_be_joined() -> None:
    from panoloc_mcl.robot.errors import ImageError
    from panoloc_mcl.tools.datasets.recordings.ros.reels import side_by_side

    with pytest.raises(ImageError, match="cannot be joined"):
        side_by_side([np.zeros((4, 4), np.uint8), cv2.resize(np.zeros((4, 4), np.uint8), (4, 5))], "here")
    assert math.prod(side_by_side([np.zeros((4, 4), np.uint8)] * 2, "here").shape) == 32
